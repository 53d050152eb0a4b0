// SPDX-License-Identifier: Apache-2.0
// The buffers of a frame, and definitions that every shader needs.
#include "frame_layout.h"
#include "stgs/format/math/screen_splat.h"

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
// The visible splats: ScreenSplat of screen_splat.h as three vectors.
layout(std430, set = 0, binding = 2) buffer SplatABuffer {
  vec4 splat_a[];  // mean; falloff.xx, falloff.xy
};
layout(std430, set = 0, binding = 3) buffer SplatBBuffer {
  vec4 splat_b[];  // falloff.yy, peak; extent
};
layout(std430, set = 0, binding = 4) buffer SplatCBuffer {
  vec4 splat_c[];  // colour; depth
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

// Returns the index of the workgroup in a dispatch that may extend along y.
uint group_number() {
  return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
}
