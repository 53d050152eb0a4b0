// SPDX-License-Identifier: Apache-2.0
#include "provided_source.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

namespace stgs::web {

Status ProvidedSource::read(std::uint64_t offset, std::span<std::uint8_t> out) const {
  STGS_TRY(check_range(name_, size_, offset, out.size()));
  std::uint64_t at = offset;
  const std::uint64_t end = offset + out.size();
  while (at < end) {
    // The range with the most bytes from `at` on.
    const std::vector<std::uint8_t>* best = nullptr;
    std::uint64_t best_at = 0, best_end = at;
    for (auto range = ranges_.begin(); range != ranges_.upper_bound(at); ++range) {
      const std::uint64_t range_end = range->first + range->second.size();
      if (range_end <= best_end) continue;
      best = &range->second;
      best_at = range->first;
      best_end = range_end;
    }
    if (best == nullptr) {
      missing_ = Range{at, end - at};
      return Status(StatusCode::kIo,
                    fmt::format("{}: bytes {} to {} have not arrived", name_, at, end));
    }
    const std::uint64_t bytes = std::min(end, best_end) - at;
    std::copy_n(best->begin() + static_cast<std::ptrdiff_t>(at - best_at), bytes,
                out.begin() + static_cast<std::ptrdiff_t>(at - offset));
    at += bytes;
  }
  return {};
}

std::span<std::uint8_t> ProvidedSource::provide(std::uint64_t offset, std::uint64_t bytes) {
  std::vector<std::uint8_t>& range = ranges_[offset];
  range.resize(static_cast<std::size_t>(bytes));
  return range;
}

std::optional<ProvidedSource::Range> ProvidedSource::take_missing() {
  return std::exchange(missing_, std::nullopt);
}

}  // namespace stgs::web
