// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace stgs::encoder {

// A frame of a video as it is stored. Frames are stored in the order of decoding.
struct StoredFrame {
  std::int64_t time = 0;  // of presentation
  bool is_key = false;    // decoding can start with it
};

// The order of presentation differs from that of decoding by fewer frames.
inline constexpr std::size_t kMaxReordered = 32;

// Returns the last stored frame from which decoding can start so that frame `first`, in the order
// of presentation, is complete: all frames that are stored before it precede it in both orders, and
// all others follow. 0 if only the first is certain. `stored` begins with the video, and has
// first + kMaxReordered frames unless the video ends.
std::size_t decode_start(std::span<const StoredFrame> stored, std::size_t first);

}  // namespace stgs::encoder
