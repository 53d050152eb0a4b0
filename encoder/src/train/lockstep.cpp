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

Result<Lockstep::Moment> Lockstep::moment(const Moment& own) {
  if (ranks_ == nullptr) return own;
  struct Wire {
    double seconds;
    std::uint64_t progress;
  };
  STGS_ASSIGN(const std::vector<Wire> all, gather(*ranks_, Wire{own.seconds, own.progress}));
  return Moment{all[0].seconds, all[0].progress != 0};
}

Result<bool> Lockstep::any(bool own) {
  if (ranks_ == nullptr) return own;
  STGS_ASSIGN(const std::vector<std::uint32_t> all, gather(*ranks_, std::uint32_t{own}));
  return std::any_of(all.begin(), all.end(), [](std::uint32_t x) { return x != 0; });
}

Result<int> Lockstep::first_other(std::uint64_t own) {
  if (ranks_ == nullptr) return 0;
  STGS_ASSIGN(const std::vector<std::uint64_t> all, gather(*ranks_, own));
  const auto other = std::find_if(all.begin(), all.end(), [&](auto x) { return x != all[0]; });
  return other == all.end() ? 0 : static_cast<int>(other - all.begin());
}

Status Lockstep::same_text(const std::string& own, const std::string& what) {
  STGS_ASSIGN(const int other, first_other(XXH3_64bits(own.data(), own.size())));
  if (other == 0) return {};
  return usage_error("process {} of {} has another {} than process 1: start all alike", other + 1,
                     size(), what);
}

Status Lockstep::same_state(std::uint64_t hash) {
  STGS_ASSIGN(const int other, first_other(hash));
  if (other == 0) return {};
  return runtime_error(
      "the state of process {} of {} is no longer that of process 1: they must run the same build "
      "on the same kind of processor or GPU",
      other + 1, size());
}

}  // namespace stgs::encoder
