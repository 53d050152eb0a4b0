// SPDX-License-Identifier: Apache-2.0
// The protocols by which the paper's tables measure (paper 4.1): the frames, their size, and the
// camera that is held out.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>

#include "stgs/encoder/prepare.h"

namespace stgs::encoder {

struct Protocol {
  std::string_view name;  // on the command line and in capture.json
  Layout layout;          // of the source capture
  int frames;             // the first ones of the source
  // Scale of the images: the usual one, and the one of some scenes; 0: none.
  double scale, other_scale;
  std::size_t test_camera;  // index in the natural order of the names; the others are trained on
};

inline constexpr std::array<Protocol, 3> kProtocols = {{
    {"n3dv", Layout::kN3dv, 300, 0.5, 0, 0},
    {"enerf-outdoor", Layout::kEasyVolcap, 300, 1, 0, 8},
    {"selfcap", Layout::kEasyVolcap, 60, 0.5, 1, 9},  // the scene bike has full size
}};

// Returns the protocol of this name; null if there is none.
const Protocol* find_protocol(std::string_view name);

// Makes `settings` those of a protocol, whose name it keeps. `scale`: of the images; 0: the usual
// one. kUsage if the protocol has no such scale.
Status apply_protocol(const Protocol& protocol, double scale, PrepareSettings& settings);

// Checks that a capture, or the window of it that a scene shows, was prepared by a protocol, and
// completely. kUsage states the command that does that; kInvalidFile if the capture was changed.
Status check_protocol(const Protocol& protocol, const PreparedCapture& capture);

}  // namespace stgs::encoder
