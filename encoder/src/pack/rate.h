// SPDX-License-Identifier: Apache-2.0
// Packs a scene within a bit rate or an error bound.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "stgs/encoder/pack.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct Packed {
  std::vector<std::uint8_t> bytes;   // of the file
  std::vector<std::uint32_t> order;  // scene index of each primitive of the file
  Scene decoded;
  double quality = 0;                         // 0..100, used for packing
  std::uint64_t left_out = 0;                 // primitives, for a limit of the size
  double position_max = 0, position_rms = 0;  // of trajectory_error(), scene units
};

// Packs with the quality of the settings, or the best file within their limit; within max_error in
// either case. Calls `before_attempt` before each attempt, of which a limit takes about ten, and
// stops with its error. kUsage if no file is small enough; kUnsupported if max_error cannot be met,
// because positions have 21 bits per segment group and motion 22.
Result<Packed> pack_within(const Scene& scene, const PackSettings& settings,
                           const std::function<Status()>& before_attempt);

// Returns the mean bit rate of a file over its duration, kbit/s.
double kbps_of(std::uint64_t bytes, const SceneMetadata& metadata);

}  // namespace stgs::encoder
