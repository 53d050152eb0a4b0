// SPDX-License-Identifier: Apache-2.0
#include "page_transport.h"

#include <utility>

#include <fmt/format.h>
#include "page.h"
#include "stream/clock_seconds.h"

namespace stgs::web {

void PageTransport::begin_read(std::uint64_t id, std::uint64_t offset,
                               std::span<std::uint8_t> out) noexcept {
  if (stopped_) {
    completion_(
        {id, Status(StatusCode::kRuntime, fmt::format("{}: closed", name_)), false, busy_seconds_});
    return;
  }
  if (reads_.empty()) busy_since_ = player::clock_seconds();
  const std::uint32_t host_id = next_id();
  reads_[host_id] = id;
  stgs_host_read(host_id, static_cast<double>(offset), static_cast<std::uint32_t>(out.size()),
                 out.data());
}

void PageTransport::cancel(std::uint64_t id) noexcept {
  for (const auto& [host_id, own] : reads_) {
    if (own == id) return stgs_host_cancel(host_id);
  }
}

void PageTransport::stop() noexcept {
  stopped_ = true;
  for (const auto& [host_id, id] : reads_) stgs_host_cancel(host_id);
}

void PageTransport::done(std::uint32_t host_id, const std::string& failure, double now) {
  const auto read = reads_.find(host_id);
  if (read == reads_.end()) return;
  const std::uint64_t id = read->second;
  reads_.erase(read);
  if (reads_.empty()) busy_seconds_ += now - busy_since_;
  const double running = reads_.empty() ? 0 : now - busy_since_;
  Status status;
  if (!failure.empty()) status = Status(StatusCode::kIo, fmt::format("{}: {}", name_, failure));
  completion_({id, std::move(status), true, busy_seconds_ + running});
}

}  // namespace stgs::web
