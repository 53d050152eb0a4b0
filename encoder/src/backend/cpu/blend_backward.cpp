// SPDX-License-Identifier: Apache-2.0
#include "backend/cpu/blend_backward.h"

#include <algorithm>
#include <cmath>

#include "backend/cpu/blend_backward_kernels.h"
#include "backend/cpu/block.h"
#include "math/grad.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster_tiles.h"

namespace stgs::encoder::cpu {
namespace {

// Splats per block of the reduction.

void add(SplatGradients& a, const SplatGradients& b) {
  a.mean.x += b.mean.x;
  a.mean.y += b.mean.y;
  a.conic.xx += b.conic.xx;
  a.conic.xy += b.conic.xy;
  a.conic.yy += b.conic.yy;
  a.colour.x += b.colour.x;
  a.colour.y += b.colour.y;
  a.colour.z += b.colour.z;
  a.opacity += b.opacity;
  a.abs_mean.x += b.abs_mean.x;
  a.abs_mean.y += b.abs_mean.y;
  a.error += b.error;
  a.weight += b.weight;
}

void add(math::Plane& a, const math::Plane& b) {
  a.normal = math::vec3_add(a.normal, b.normal);
  a.distance += b.distance;
}

math::Plane plane_at(const Image& d_surface, std::size_t p) {
  return {{d_surface.plane(0)[p], d_surface.plane(1)[p], d_surface.plane(2)[p]},
          d_surface.plane(3)[p]};
}

// Sums each splat's entries, in order, into out[s].
template <typename T>
void sum_by_splat(const BlendBackwardScratch& scratch, const std::vector<T>& instances,
                  std::size_t splats, std::vector<T>& out) {
  out.resize(splats);
  parallel_blocks(std::size_t{0}, splats, kBlock, [&](std::size_t first, std::size_t last) {
    for (std::size_t s = first; s < last; ++s) {
      T sum{};
      for (std::uint32_t k = scratch.splat_begin[s]; k < scratch.splat_begin[s + 1]; ++k)
        add(sum, instances[scratch.of_splat[k]]);
      out[s] = sum;
    }
  });
}

// Lists each splat's entries of frame.instances, in ascending order.
void list_by_splat(const SplatFrame& frame, BlendBackwardScratch& scratch) {
  auto& begin = scratch.splat_begin;
  begin.assign(frame.splats.size() + 2, 0);
  scratch.of_splat.resize(frame.instances.size());
  // Offset by two, so that after the scatter begin[s] is the first entry of s.
  for (std::uint32_t s : frame.instances) ++begin[s + 2];
  for (std::size_t s = 2; s < begin.size(); ++s) begin[s] += begin[s - 1];
  for (std::uint32_t k = 0; k < frame.instances.size(); ++k)
    scratch.of_splat[begin[frame.instances[k] + 1]++] = k;
}

}  // namespace

void blend_backward_tile_scalar(const TileBackward& t) {
  using namespace math;
  const raster::PixelBox box = raster::tile_pixels(t.frame, t.tile);
  const std::uint32_t first = t.frame.tile_begin[t.tile];
  const std::uint32_t count = t.frame.tile_begin[t.tile + 1] - first;
  std::fill_n(t.out, count, SplatGradients{});
  if (t.planes) std::fill_n(t.plane_out, count, Plane{});
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x) {
      const std::size_t p = static_cast<std::size_t>(y) * t.frame.width + x;
      const Vec3 d = {t.d_colour.plane(0)[p], t.d_colour.plane(1)[p], t.d_colour.plane(2)[p]};
      const float error = t.error ? t.error->data[p] : 0.0f;
      const Plane d_plane = t.planes ? plane_at(t.planes->d_surface, p) : Plane{};
      float transmittance = t.forward.transmittance.data[p];
      // dL/dcolour . (colour behind the splat).
      float behind = dot3(d, t.settings.background);
      for (std::uint32_t k = t.forward.last[p]; k-- > 0;) {
        const std::uint32_t index = t.frame.instances[first + k];
        const Splat& s = t.frame.splats[index];
        const float dx = static_cast<float>(x) + 0.5f - s.mean.x;
        const float dy = static_cast<float>(y) + 0.5f - s.mean.y;
        const float power = splat_power(s.conic, dx, dy);
        const float alpha = splat_alpha(s.opacity, power);
        if (alpha == 0.0f) continue;
        transmittance /= 1.0f - alpha;
        const float weight = alpha * transmittance;
        float own = dot3(d, s.colour);
        if (t.planes) {
          const Plane& plane = t.planes->planes[index];
          own += dot3(d_plane.normal, plane.normal) + d_plane.distance * plane.distance;
          add(t.plane_out[k], {vec3_scale(d_plane.normal, weight), d_plane.distance * weight});
        }
        const AlphaGrad by = splat_alpha_grad(s.opacity, power, transmittance * (own - behind));
        const PowerGrad g = splat_power_grad(s.conic, dx, dy, by.power);
        behind += alpha * (own - behind);
        add(t.out[k], {{-g.offset.x, -g.offset.y},
                       g.conic,
                       vec3_scale(d, weight),
                       by.opacity,
                       {std::abs(g.offset.x), std::abs(g.offset.y)},
                       weight * error,
                       weight});
      }
    }
  }
}

void blend_backward(const SplatFrame& frame, const RasterSettings& settings,
                    const RasterOutput& forward, const Image& d_colour, const Image* error,
                    BlendBackwardScratch& scratch, std::vector<SplatGradients>& out,
                    const PlanesBackward* planes) {
  scratch.instances.resize(frame.instances.size());
  if (planes) scratch.plane_instances.resize(frame.instances.size());
  const auto backward = settings.scalar ? blend_backward_tile_scalar : blend_backward_tile_vector;
  parallel_for(0, frame.tiles_x * frame.tiles_y, [&](int tile) {
    const std::size_t first = frame.tile_begin[tile];
    backward({frame, settings, forward, d_colour, error, tile, scratch.instances.data() + first,
              planes, planes ? scratch.plane_instances.data() + first : nullptr});
  });
  list_by_splat(frame, scratch);
  sum_by_splat(scratch, scratch.instances, frame.splats.size(), out);
  if (planes) sum_by_splat(scratch, scratch.plane_instances, frame.splats.size(), planes->d_planes);
}

}  // namespace stgs::encoder::cpu
