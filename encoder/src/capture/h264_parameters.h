// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

namespace stgs::encoder {

// Returns whether the parameters of an H.264 track, as a container stores them (avcC, or with start
// codes), state frames without chroma. False also if they state no format.
bool is_grey_h264(std::span<const std::uint8_t> parameters);

// The same for parameters within a packet of the track.
bool is_grey_h264_packet(std::span<const std::uint8_t> parameters,
                         std::span<const std::uint8_t> packet);

}  // namespace stgs::encoder
