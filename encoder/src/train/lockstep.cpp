// SPDX-License-Identifier: Apache-2.0
#include "train/lockstep.h"

#include <xxhash.h>

#include <algorithm>
#include <vector>

namespace stgs::encoder {
namespace {

template <typename T>
Result<std::vector<T>> gather(Ranks& ranks, const T& own) {
  std::vector<T> all(static_cast<std::size_t>(ranks.size()));
  STGS_TRY(ranks.all_gather(&own, sizeof(T), all.data()));
  return all;
}

}  // namespace

Result<Lockstep::ClockState> Lockstep::sync_clock(const ClockState& own) {
  if (ranks_ == nullptr) return own;
  struct Wire {
    double seconds;
    std::uint64_t is_progress_due;
  };
  STGS_ASSIGN(const std::vector<Wire> all, gather(*ranks_, Wire{own.seconds, own.is_progress_due}));
  return ClockState{all[0].seconds, all[0].is_progress_due != 0};
}

Result<bool> Lockstep::any(bool own) {
  if (ranks_ == nullptr) return own;
  STGS_ASSIGN(const std::vector<std::uint32_t> all, gather(*ranks_, std::uint32_t{own}));
  return std::any_of(all.begin(), all.end(), [](std::uint32_t x) { return x != 0; });
}

Result<int> Lockstep::first_mismatch(std::uint64_t own) {
  if (ranks_ == nullptr) return 0;
  STGS_ASSIGN(const std::vector<std::uint64_t> all, gather(*ranks_, own));
  const auto mismatch = std::find_if(all.begin(), all.end(), [&](auto x) { return x != all[0]; });
  return mismatch == all.end() ? 0 : static_cast<int>(mismatch - all.begin());
}

Status Lockstep::check_same_text(const std::string& own, const std::string& subject) {
  STGS_ASSIGN(const int mismatch, first_mismatch(XXH3_64bits(own.data(), own.size())));
  if (mismatch == 0) return {};
  return usage_error(
      "process {} of {}: different {} than process 1; start all processes with the same arguments",
      mismatch + 1, size(), subject);
}

Status Lockstep::check_same_state(std::uint64_t hash) {
  STGS_ASSIGN(const int mismatch, first_mismatch(hash));
  if (mismatch == 0) return {};
  return runtime_error(
      "process {} of {}: its state has diverged from that of process 1; run the same build on the "
      "same model of CPU or GPU everywhere",
      mismatch + 1, size());
}

}  // namespace stgs::encoder
