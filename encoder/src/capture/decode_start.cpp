// SPDX-License-Identifier: Apache-2.0
#include "decode_start.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace stgs::encoder {

std::size_t decode_start(std::span<const StoredFrame> stored, std::size_t first) {
  std::size_t before = 0, candidate = 0;
  std::int64_t latest = std::numeric_limits<std::int64_t>::min();  // of the frames before
  for (std::size_t i = 0; i < stored.size(); ++i) {
    const StoredFrame& frame = stored[i];
    // A frame that is presented before a key frame, but stored after it, needs earlier ones.
    while (candidate > 0 && frame.time <= stored[candidate].time)
      candidate = std::exchange(before, 0);
    if (frame.is_key && i <= first && frame.time > latest) {
      before = candidate;
      candidate = i;
    }
    latest = std::max(latest, frame.time);
  }
  return candidate;
}

}  // namespace stgs::encoder
