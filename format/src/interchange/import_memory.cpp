// SPDX-License-Identifier: Apache-2.0
#include "interchange/import_memory.h"

#include <algorithm>
#include <limits>

namespace stgs {
namespace {

constexpr Budget::Pool kPool = Budget::Pool::kImport;
constexpr std::uint64_t kMaxCount = 0xFFFFFFFF;  // primitives have indices of 32 bits

std::uint64_t sum(std::uint64_t a, std::uint64_t b) {
  return a > std::numeric_limits<std::uint64_t>::max() - b
             ? std::numeric_limits<std::uint64_t>::max()
             : a + b;
}

}  // namespace

std::uint64_t import_bytes(std::uint64_t count, int sh_degree) {
  const int coefficients = (sh_degree + 1) * (sh_degree + 1);
  return count * sizeof(float) * static_cast<unsigned>(17 + 3 * coefficients);
}

ImportMemory::ImportMemory(const ReadLimits& limits, std::string name)
    : limits_(limits), name_(std::move(name)) {
  budget_.set_limit(kPool, limits.max_memory);
}

Status ImportMemory::check(std::uint64_t bytes, std::string_view what) {
  if (budget_.fits(kPool, bytes)) return {};
  has_refused_ = true;
  return unsupported(
      "{}: {} exceed the memory limit of {} bytes (need {} bytes); allow more memory", name_, what,
      limits_.max_memory, sum(budget_.usage(kPool).used, bytes));
}

Result<Lease> ImportMemory::take(std::uint64_t bytes, std::string_view what) {
  STGS_TRY(check(bytes, what));
  return budget_.charge(kPool, bytes);
}

Status ImportMemory::grow(Lease& lease, std::uint64_t bytes, std::string_view what) {
  if (bytes <= lease.bytes()) return {};
  STGS_ASSIGN(Lease more, take(bytes - lease.bytes(), what));
  lease.merge(std::move(more));
  return {};
}

Status ImportMemory::check_count(std::uint64_t count) {
  const std::uint64_t most = std::min(limits_.max_primitives, kMaxCount);
  if (count <= most) return {};
  has_refused_ = true;
  return unsupported("{}: too many primitives (at most {} allowed, got {})", name_, most, count);
}

Result<Lease> ImportMemory::take_set(std::uint64_t count, int sh_degree) {
  STGS_TRY(check_count(count));
  return take(import_bytes(count, sh_degree), fmt::format("{} primitives", count));
}

Status ImportMemory::reserve(Gaussians4D& set, Lease& lease, std::uint64_t count) {
  const std::uint64_t capacity = set.opacity_logit.capacity();
  if (count <= capacity) return {};
  STGS_TRY(check_count(count));
  // The arrays are copied one after the other. The old ones count until all are.
  const std::uint64_t more = std::min({capacity + capacity / 2, limits_.max_primitives, kMaxCount});
  const bool fits = more > count && import_bytes(more, set.sh_degree) <= available();
  const std::uint64_t next = fits ? more : count;
  STGS_ASSIGN(Lease charge, take_set(next, set.sh_degree));
  set.reserve(static_cast<std::size_t>(next));
  lease = std::move(charge);
  return {};
}

}  // namespace stgs
