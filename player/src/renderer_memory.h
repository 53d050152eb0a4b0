// SPDX-License-Identifier: Apache-2.0
// The memory of a renderer, charged to the budget of the timeline that it renders.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "stgs/format/budget.h"
#include "stgs/format/status.h"
#include "stgs/player/timeline.h"

namespace stgs::player {

// Memory that all renderers of a timeline may take together, whatever its memory budget, bytes:
// that of the images of 7680x4320 pixels.
inline constexpr std::uint64_t kMinRendererMemory = std::uint64_t{1} << 30;

// Creates the budget of a timeline:
// - the pools kSegments and kDeviceCopies may hold `memory_budget`,
// - kDecodeScratch 1/16 of it,
// - kRenderer as much as it, and at least kMinRendererMemory.
std::shared_ptr<Budget> make_budget(std::uint64_t memory_budget);

// Returns the error (kLimit) if rendering the timeline `name` needs `bytes` in total and its
// renderers may take `limit`. `what` is what the last of them are for.
Status renderer_limit_error(const std::string& name, const char* what, std::uint64_t bytes,
                            std::uint64_t limit);

// What a renderer allocates in proportion to the scene and the images, in the pool kRenderer.
class RendererMemory : public WorkingMemory {
 public:
  // Charges to the budget of a timeline from now on. Returns false if the present charge exceeds
  // its limit: free memory then.
  bool use(const Timeline& timeline);
  // Charges `bytes`, or returns the error.
  Status charge(std::uint64_t bytes);
  // As renderer_limit_error(), for this timeline.
  Status limit_error(const char* what, std::uint64_t bytes) const {
    return renderer_limit_error(name_, what, bytes, limit());
  }

 private:
  std::string name_;  // of the timeline
};

// Calls draw(), which allocates memory for a frame of the timeline. If what earlier frames have
// left exceeds the limit, frees it and tries again; `has_memory`: there is some. After kLimit, the
// memory is free.
template <typename Draw, typename FreeMemory>
Status draw_within_limit(RendererMemory& memory, const Timeline& timeline, bool has_memory,
                         const Draw& draw, const FreeMemory& free_memory) {
  if (!memory.use(timeline)) STGS_TRY(free_memory());
  Status status = draw();
  if (status.code() != StatusCode::kLimit) return status;
  STGS_TRY(free_memory());
  if (!has_memory) return status;
  status = draw();
  if (status.code() == StatusCode::kLimit) STGS_TRY(free_memory());
  return status;
}

}  // namespace stgs::player
