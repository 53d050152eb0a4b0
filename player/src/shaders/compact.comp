// SPDX-License-Identifier: Apache-2.0
// Compacts the splats of all chunks into keys and values for the sort by depth.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 2) writeonly buffer KeyBuffer {
  uint keys[];
};
layout(std430, set = 1, binding = 3) writeonly buffer ValueBuffer {
  uint values[];
};

uint first_of(uint chunk) {
  return chunk < frame.views * frame.chunks ? chunk_offsets[chunk] + chunk_sums[chunk / kScanTile]
                                            : visible;
}

void main() {
  uint begin = group_number() * kCompactChunks, k = gl_LocalInvocationIndex;
  uint firsts[kCompactChunks + 1u];
  float depths[kCompactChunks];
  // Issue all loads at once to hide memory latency.
  [[unroll]] for (uint c = 0u; c <= kCompactChunks; ++c) firsts[c] = first_of(begin + c);
  [[unroll]] for (uint c = 0u; c < kCompactChunks; ++c) {
    bool is_used = k < firsts[c + 1u] - firsts[c];
    depths[c] = is_used ? splat_c[(begin + c) * kGroup + k].w : 0.0f;
  }
  [[unroll]] for (uint c = 0u; c < kCompactChunks; ++c) {
    if (k >= firsts[c + 1u] - firsts[c]) continue;
    // Depths are positive (at least the near plane), so their bits sort as their values.
    keys[firsts[c] + k] = floatBitsToUint(depths[c]);
    values[firsts[c] + k] = (begin + c) * kGroup + k;
  }
}
