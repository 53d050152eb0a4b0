// SPDX-License-Identifier: Apache-2.0
// Draws the splats of records: for each, a rectangle around the pixels that it covers. An instance
// has kQuads of them, with four vertices each.
#include "record.glsl"
#include "stgs/format/math/screen_splat.h"

uniform usampler2D records_a, records_b;  // that project.frag.glsl wrote
uniform vec2 image_size;                  // pixels
// (a, b, c): a splat at z in front of the camera has depth a + b / z + c log2(1 + z), in NDC.
uniform vec3 depth_mapping;

flat out vec4 splat_a;  // mean, falloff.xx, falloff.xy
flat out vec2 splat_b;  // falloff.yy, peak
flat out vec3 splat_colour;
flat out float splat_depth;

const uint kQuads = 64u;  // as in records.ts
// Enlarges rectangles that are not aligned to pixels, for the rounding of their corners; pixels.
const float kBoxMargin = 0.0625;
const float kRelativeError = 1e-6;  // of their sizes

// Returns in `corner` the corner, on a side of -1 or 1 of each axis, of a rectangle that contains
// all visible pixels of a splat: its bounding box in the image, or, if that is larger, the box
// along the axes of its ellipse. Returns false if no pixel of the image is in the bounding box.
bool corner_at(vec2 mean, vec2 extent, Sym2 conic, vec2 side, out vec2 corner) {
  // Edges of the pixels whose centres are in the box, so that rounding at its edges cuts nothing.
  vec2 low = max(ceil(mean - extent - 0.5), vec2(0.0));
  vec2 high = min(floor(mean + extent + 0.5), image_size);
  if (!(low.x < high.x && low.y < high.y)) return false;
  corner = mix(low, high, 0.5 * side + 0.5);
  // The covariance is (yy, -xy, xx) of the conic, times its determinant. The squared half sizes
  // along the axes of the ellipse are its eigenvalues, times the scale that makes a box of
  // `extent`.
  float trace = conic.xx + conic.yy, difference = conic.yy - conic.xx;
  float root = sqrt(difference * difference + 4.0 * conic.xy * conic.xy);
  float scale = extent.x * extent.x / conic.yy;
  vec2 squares = vec2(trace + root, max(0.0, trace - root) + kRelativeError * trace);
  vec2 half_size = sqrt(0.5 * scale * squares) + kBoxMargin;
  float area = (high.x - low.x) * (high.y - low.y);
  if (!(root > 0.0 && 4.0 * half_size.x * half_size.y < area)) return true;
  // The long axis, in the more precise of two forms.
  vec2 along = difference >= 0.0 ? vec2(difference + root, -2.0 * conic.xy)
                                 : vec2(-2.0 * conic.xy, root - difference);
  along = normalize(along);
  corner = mean + side.x * half_size.x * along + side.y * half_size.y * vec2(-along.y, along.x);
  return true;
}

void main() {
  gl_Position = vec4(2.0, 2.0, 0.0, 1.0);  // outside the image: nothing is drawn
  splat_a = vec4(0.0);
  splat_b = vec2(0.0);
  splat_colour = vec3(0.0);
  splat_depth = 0.0;
  uint corner_number = uint(gl_VertexID) & 3u;
  uint record = uint(gl_InstanceID) * kQuads + (uint(gl_VertexID) >> 2u);
  ivec2 texel = ivec2(record % kRecordRow, record / kRecordRow);
  uvec4 b = texelFetch(records_b, texel, 0);
  if (!is_visible(b)) return;
  Splat splat = unpack_splat(texelFetch(records_a, texel, 0), b);
  Sym2 conic = conic_of(splat.falloff);
  vec2 side =
      vec2((corner_number & 1u) == 0u ? -1.0 : 1.0, (corner_number & 2u) == 0u ? -1.0 : 1.0);
  vec2 extent = splat.extent * vec2(1.0, sqrt(conic.xx / conic.yy));
  vec2 corner;
  if (!corner_at(splat.mean, extent, conic, side, corner)) return;
  vec2 clip = 2.0 * corner / image_size - 1.0;
  float depth =
      depth_mapping.x + depth_mapping.y / splat.depth + depth_mapping.z * log2(1.0 + splat.depth);
  gl_Position = vec4(clip.x, -clip.y, depth, 1.0);
  splat_a = vec4(splat.mean, splat.falloff.xx, splat.falloff.xy);
  splat_b = vec2(splat.falloff.yy, splat.peak);
  splat_colour = splat.colour;
  splat_depth = splat.depth;
}
