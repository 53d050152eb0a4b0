// SPDX-License-Identifier: Apache-2.0
// The steps that keep a packed scene within a bit rate or an error.
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
  std::vector<std::uint32_t> order;  // for each primitive of the file its index in the scene
  Scene decoded;
  double quality = 0;                         // 0..100, that it was packed with
  double position_max = 0, position_rms = 0;  // of the primitives' trajectory_error
};

// Packs as the settings say: at their quality; or at the greatest, in steps of 1/8, that takes no
// more than target_kbps; within max_error in each case. `go_on` is asked before each attempt, of
// which a bit rate takes about ten. kUsage where no quality is small enough; kUnsupported where the
// error cannot be kept, as positions have 21 bits over what lies together, and motion 22.
Result<Packed> pack_within(const Scene& scene, const PackSettings& settings,
                           const std::function<Status()>& go_on);

// Mean bit rate of a file over its duration, thousands of bits a second.
double kbps_of(std::uint64_t bytes, const SceneMetadata& metadata);

}  // namespace stgs::encoder
