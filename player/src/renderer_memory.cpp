// SPDX-License-Identifier: Apache-2.0
#include "renderer_memory.h"

#include <algorithm>

namespace stgs::player {
namespace {

// Divisor of the memory budget: the share that may be decoded at once.
constexpr std::uint64_t kDecodeShare = 16;

// Rounds up, so that the number suffices as a limit.
std::uint64_t mebibytes(std::uint64_t bytes) {
  return (bytes >> 20) + ((bytes & 0xFFFFF) != 0 ? 1 : 0);
}

}  // namespace

std::shared_ptr<Budget> make_budget(std::uint64_t memory_budget) {
  auto budget = std::make_shared<Budget>();
  budget->set_limit(Budget::Pool::kSegments, memory_budget);
  budget->set_limit(Budget::Pool::kDecodeScratch, memory_budget / kDecodeShare);
  budget->set_limit(Budget::Pool::kDeviceCopies, memory_budget);
  budget->set_limit(Budget::Pool::kRenderer, std::max(memory_budget, kMinRendererMemory));
  return budget;
}

bool RendererMemory::use(const Timeline& timeline) {
  const std::shared_ptr<Budget>& budget = timeline.budget();
  name_ = timeline.name();
  WorkingMemory::use(budget, Budget::Pool::kRenderer);
  const Budget::Usage usage = budget->usage(Budget::Pool::kRenderer);
  return usage.used <= usage.limit;
}

Status RendererMemory::charge(std::uint64_t bytes) {
  if (try_charge(bytes)) return {};
  return limit_error("the frame", this->bytes() + bytes);
}

Status renderer_limit_error(const std::string& name, const char* what, std::uint64_t bytes,
                            std::uint64_t limit) {
  return {StatusCode::kLimit,
          fmt::format("{}: rendering needs too much memory for {} (limit {} MiB, need at least {} "
                      "MiB); render fewer pixels or allow more memory",
                      name, what, limit >> 20, mebibytes(bytes))};
}

}  // namespace stgs::player
