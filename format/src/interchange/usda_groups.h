// SPDX-License-Identifier: Apache-2.0
// The prims of a USD file: primitives grouped by the frames in which they are visible, so that each
// prim has time samples for these frames only.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs {

// The primitives of one prim. Ordered by kind and time.
struct UsdaGroup {
  // kMoves: only positions have samples. kFades: opacities do, positions too if one moves.
  enum Kind { kStatic, kMoves, kFades } kind = kStatic;
  std::uint32_t first = 0, last = 0;  // frames with samples
  auto operator<=>(const UsdaGroup&) const = default;
};
using UsdaGroups = std::map<UsdaGroup, std::vector<std::uint32_t>>;

// Differences between the scene and the file.
struct UsdaStatistics {
  // Of primitives whose opacity, or also position, has no samples.
  double static_opacity_max = 0, static_position_max = 0;
  std::uint64_t between_frames = 0;  // primitives visible only between frames
  double interpolation_max = 0;      // of the opacity, half-way between frames
};

// Groups the primitives of a scene. `set` has those of the scene, in any axes. Both must outlive
// the object.
class UsdaGrouper {
 public:
  UsdaGrouper(const Scene& scene, const Gaussians4D& set)
      : scene_(scene), set_(set), last_frame_(scene.metadata.frames - 1) {}

  // Returns the primitives that are visible at a frame. The work depends on their number, and on
  // that of the frames only by its logarithm.
  UsdaGroups groups(UsdaStatistics& statistics) const;
  // Returns the opacity of a primitive without samples of it.
  float constant_opacity(std::size_t i) const;
  // Returns the opacity of a primitive at a time of the scene; 0 if it is not rendered. `part`:
  // that of the primitive, null in a scene without parts.
  double opacity_at(std::size_t i, const ScenePart* part, double ticks) const;

 private:
  struct OpacityRange {
    double low, high;
  };
  void add(std::size_t i, const ScenePart* part, UsdaGroups& out, UsdaStatistics& statistics) const;
  double visible_frame(std::size_t i, const ScenePart* part, double centre, double begin,
                       double end) const;
  double last_visible(std::size_t i, const ScenePart* part, double visible, double limit) const;
  UsdaGroup group_of(std::size_t i, const ScenePart* part, double begin, double end,
                     UsdaStatistics& statistics) const;
  OpacityRange opacities(std::size_t i) const;
  double half_path(std::size_t i) const;
  double middle_scale(std::size_t i) const;

  const Scene& scene_;
  const Gaussians4D& set_;
  std::uint32_t last_frame_;
};

}  // namespace stgs
