// SPDX-License-Identifier: Apache-2.0
// The buffers of a frame, and definitions that every shader needs.
#include "frame_layout.h"

layout(constant_id = 2) const bool kFovea = false;  // for listing and blending: a view has a fovea

layout(std430, set = 0, binding = 0) readonly buffer InputBuffer {
  FrameInput frame;
  Part parts[];
};
layout(std430, set = 0, binding = 1) buffer CountBuffer {
  uint active_count;  // primitives that are active, on screen or not
  uint visible;       // splats, over all views
  uint listed;        // instances that are sorted and rendered: limited by the capacity
  uint instances;     // total, even if they exceed the capacity; at most kManyInstances
  uvec4 work[kWorks];
  uint ended[kEnded];
  uint patch_counts[kPatchKinds * kMaxFrameViews];  // per view and kind: find_patches.comp
};
// A visible splat. At pixel offset (dx, dy), log2 of its alpha is
// min(peak, peak + dx (half_xx dx + cross dy) + half_yy dy^2).
layout(std430, set = 0, binding = 2) buffer SplatABuffer {
  vec4 splat_a[];  // x, y; -log2(e) conic.xx / 2, -log2(e) conic.xy
};
layout(std430, set = 0, binding = 3) buffer SplatBBuffer {
  vec4 splat_b[];  // -log2(e) conic.yy / 2, log2(O_t); half size of the box, pixels
};
layout(std430, set = 0, binding = 4) buffer SplatCBuffer {
  vec4 splat_c[];  // red, green, blue; camera z
};
// The offset of a chunk is the sum of two parts: within kScanTile chunks, and of the scan tiles
// before.
layout(std430, set = 0, binding = 5) buffer ChunkPlaceBuffer {
  uint chunk_offsets[];
};
layout(std430, set = 0, binding = 6) coherent buffer ChunkSumBuffer {
  uint chunk_sums[];
};
layout(std430, set = 0, binding = 7) coherent buffer TilePlaceBuffer {
  uint tile_offsets[];
};
layout(std430, set = 0, binding = 8) buffer RangeBuffer {
  // Per tile: ~first and last + 1 of its instances, both computed as a maximum; 0 and 0 if it has
  // none. A square at half resolution has all instances at its first tile.
  uvec2 tile_ranges[];
};
// Rows of kDigits counts, the number of keys with each digit: per workgroup of a sort pass, and
// then per super group of each pass.
layout(std430, set = 0, binding = 9) buffer DigitBuffer {
  uint digit_counts[];
};
// The image of a view, one buffer per plane: all planes of a large image may exceed a storage
// buffer.
layout(std430, set = 0, binding = 10) writeonly buffer RedBuffer {
  float red_plane[];
};
layout(std430, set = 0, binding = 11) writeonly buffer GreenBuffer {
  float green_plane[];
};
layout(std430, set = 0, binding = 12) writeonly buffer BlueBuffer {
  float blue_plane[];
};
layout(std430, set = 0, binding = 13) writeonly buffer AlphaBuffer {
  float alpha_plane[];
};
layout(std430, set = 0, binding = 14) writeonly buffer DepthBuffer {
  float depth_plane[];
};

layout(push_constant) uniform PushBlock {
  Push push;
};

const float kLog2Threshold = -7.99435344f;  // log2(kAlphaThreshold)
// Slightly above log2(kAlphaMax): regardless of the rounding of exp2, two such splats end a pixel,
// as two of kAlphaMax do.
const float kLog2AlphaMax = -0.014499f;

// Returns the index of the workgroup in a dispatch that may extend along y.
uint group_number() {
  return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
}

// Tests the bits, which compilers cannot optimise away.
bool finite(float x) {
  return (floatBitsToUint(x) & 0x7F800000u) != 0x7F800000u;
}
