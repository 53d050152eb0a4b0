// SPDX-License-Identifier: Apache-2.0
// The buffers of a frame, and what every shader needs.
#include "frame_layout.h"

layout(constant_id = 2) const bool kFovea = false;  // of lists and blends: whether a view has one

layout(std430, set = 0, binding = 0) readonly buffer InputBuffer {
  FrameInput frame;
  Part parts[];
};
layout(std430, set = 0, binding = 1) buffer CountBuffer {
  uint alive;      // seen at the moment, on the screen or not
  uint visible;    // splats, of all views
  uint listed;     // instances that are sorted and drawn: all, or as many as there is room for
  uint instances;  // in all, also where they did not fit; kManyInstances at most
  uvec4 work[kWorks];
  uint ended[kEnded];
  uint patch_counts[kPatchKinds * kMostViews];  // of each view each kind: find_patches.comp
};
// A visible primitive on the screen. At pixel offset (dx, dy), log2 of its alpha is
// min(most, most + dx (half_xx dx + cross dy) + half_yy dy^2).
layout(std430, set = 0, binding = 2) buffer SplatABuffer {
  vec4 splat_a[];  // x, y; -log2(e) conic.xx / 2, -log2(e) conic.xy
};
layout(std430, set = 0, binding = 3) buffer SplatBBuffer {
  vec4 splat_b[];  // -log2(e) conic.yy / 2, log2(O_t); half size of the box, pixels
};
layout(std430, set = 0, binding = 4) buffer SplatCBuffer {
  vec4 splat_c[];  // red, green, blue; camera z
};
// Sums before a chunk are in two parts, within kScanTile chunks and of those tiles before.
layout(std430, set = 0, binding = 5) buffer ChunkPlaceBuffer {
  uint chunk_places[];
};
layout(std430, set = 0, binding = 6) coherent buffer ChunkSumBuffer {
  uint chunk_sums[];
};
layout(std430, set = 0, binding = 7) coherent buffer TilePlaceBuffer {
  uint tile_places[];
};
layout(std430, set = 0, binding = 8) buffer RangeBuffer {
  // Of a tile of the frame: ~first and last + 1 of its instances, both the greatest that was found
  // on them; 0 and 0 where it has none. A square at half resolution has all at its first tile.
  uvec2 tile_ranges[];
};
// Rows of kDigits numbers, how many keys have each digit: of the workgroups of a pass of the sort,
// and then, for each pass, of its super groups.
layout(std430, set = 0, binding = 9) buffer DigitBuffer {
  uint digit_counts[];
};
// A view's picture, a plane each: of a large one, not all fit a storage buffer together.
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
// A little above log2(kAlphaMax): whatever exp2 rounds, two such splats end a pixel, as
// kAlphaMax's.
const float kLog2AlphaMax = -0.014499f;

// The workgroup's number in a dispatch that may extend along y.
uint group_number() {
  return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
}

// By the bits, which no compiler takes for granted.
bool finite(float x) {
  return (floatBitsToUint(x) & 0x7F800000u) != 0x7F800000u;
}
