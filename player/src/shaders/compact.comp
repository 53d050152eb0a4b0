// SPDX-License-Identifier: Apache-2.0
// The keys of the sort by depth: what each chunk has, side by side.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 2) writeonly buffer KeyBuffer {
  uint keys[];
};
layout(std430, set = 1, binding = 3) writeonly buffer ValueBuffer {
  uint values[];
};

uint all_chunks() {
  return frame.views * frame.chunks;
}

uint first_of(uint chunk) {
  return chunk < all_chunks() ? chunk_places[chunk] + chunk_sums[chunk / kScanTile] : visible;
}

void main() {
  uint chunk = group_number();
  if (chunk >= all_chunks()) return;
  uint first = first_of(chunk), count = first_of(chunk + 1u) - first;
  uint k = gl_LocalInvocationIndex;
  if (k >= count) return;
  // A depth is at least the near plane's, and the bits of positive numbers are in their order.
  keys[first + k] = floatBitsToUint(splat_c[chunk * kGroup + k].w);
  values[first + k] = chunk * kGroup + k;
}
