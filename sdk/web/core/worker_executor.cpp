// SPDX-License-Identifier: Apache-2.0
#include "worker_executor.h"

#include <exception>

#include <fmt/format.h>
#include "page.h"
#include "part_decoder.h"

namespace stgs::web {

void WorkerExecutor::submit(player::DecodeJob job) noexcept {
  Status status;
  const std::uint32_t id = next_++;
  try {
    failed_.reserve(failed_.size() + 1);
    status = pass_on(id, job);
    if (status.ok()) jobs_.emplace(id, std::move(job));
  } catch (const std::exception& e) {
    status = Status(code_of(e), e.what());
  }
  if (!status.ok()) failed_.emplace_back(std::move(job), std::move(status));
}

Status WorkerExecutor::pass_on(std::uint32_t id, const player::DecodeJob& job) {
  const SegmentInfo& info = job.reader->segments()[job.segment];
  const std::uint64_t sh_bytes = job.with_sh ? info.sh_bytes : 0;
  std::vector<std::uint8_t> base(info.bytes), sh(sh_bytes);
  STGS_TRY(source_->read(info.offset, base));
  if (sh_bytes > 0) STGS_TRY(source_->read(info.sh_offset, sh));
  const std::vector<std::uint8_t> segment = write_job(*job.reader, job.segment);
  stgs_host_decode(id, segment.data(), static_cast<std::uint32_t>(segment.size()), job.with_sh,
                   static_cast<double>(info.offset), base.data(),
                   static_cast<std::uint32_t>(base.size()), static_cast<double>(info.sh_offset),
                   sh.data(), static_cast<std::uint32_t>(sh.size()));
  return {};
}

void WorkerExecutor::poll() noexcept {
  if (failed_.empty()) return;
  auto [job, status] = std::move(failed_.back());
  failed_.pop_back();
  player::DecodeResult result;
  result.base = std::move(status);
  completion_(std::move(job), std::move(result));
}

void WorkerExecutor::stop() noexcept {
  jobs_.clear();
  failed_.clear();
}

void WorkerExecutor::done(std::uint32_t id, double time_origin, Status base, Status sh) {
  const auto found = jobs_.find(id);
  if (found == jobs_.end()) return;
  player::DecodeResult result;
  if (base.ok()) result.decoded = stand_in(id, time_origin);
  result.base = std::move(base);
  result.sh = std::move(sh);
  player::DecodeJob job = std::move(found->second);
  jobs_.erase(found);
  completion_(std::move(job), std::move(result));
}

player::DecodedSegment WorkerExecutor::stand_in(std::uint32_t id, double time_origin) {
  auto segment = std::make_unique<player::ResidentSegment>();
  segment->set.time_origin = time_origin;
  Decoded& decoded = *decoded_;
  decoded.released.reserve(decoded.released.size() + decoded.ids.size() + 1);
  decoded.ids.emplace(&segment->set, id);
  const auto release = [keep = decoded_, id](const player::ResidentSegment* one) {
    keep->ids.erase(&one->set);
    keep->released.push_back(id);
    delete one;
  };
  return player::DecodedSegment(segment.release(), release);
}

std::uint32_t WorkerExecutor::id_of(const Gaussians4D& set) const {
  const auto found = decoded_->ids.find(&set);
  return found == decoded_->ids.end() ? 0 : found->second;
}

std::uint32_t WorkerExecutor::take_released() {
  if (decoded_->released.empty()) return 0;
  const std::uint32_t id = decoded_->released.back();
  decoded_->released.pop_back();
  return id;
}

}  // namespace stgs::web
