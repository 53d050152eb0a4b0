// SPDX-License-Identifier: Apache-2.0
#include "vulkan/frame_views.h"

#include <algorithm>
#include <cmath>

#include "views.h"
#include "vulkan/caller_images.h"

namespace stgs::player::vulkan {
namespace {

constexpr std::uint64_t kPlaneAlign = 256;  // sufficient for every device

int tiles_along(int pixels) {
  return (pixels + kTilePixels - 1) / kTilePixels;
}

}  // namespace

void ViewImage::set_size(const View& view) {
  width = static_cast<int>(std::lround(view.camera.width));
  height = static_cast<int>(std::lround(view.camera.height));
}

std::uint32_t ViewImage::tiles() const {
  return static_cast<std::uint32_t>(tiles_along(width) * tiles_along(height));
}

std::uint64_t ViewImage::plane_bytes() const {
  return (sizeof(float) * pixels() + kPlaneAlign - 1) / kPlaneAlign * kPlaneAlign;
}

ImageBuffers ViewImage::buffers(const VulkanTarget* to) const {
  ImageBuffers out;
  for (std::uint32_t plane = 0; to == nullptr && plane < kPlanes; ++plane) {
    out.planes[plane] = {planes.handle(), plane * plane_bytes(), plane_bytes()};
  }
  if (to == nullptr) return out;
  out.pixels = pixel_format(to->colour.format).pixels;
  out.packed = packed.handle();
  if (to->depth) out.planes[kPlanes - 1] = {depth.handle(), 0, plane_bytes()};
  return out;
}

namespace {

// `at_once`: bytes that a shader binds at once.
Status grow(const Device& device, Buffer& buffer, std::uint64_t bytes, const ViewImage& image,
            std::uint64_t at_once, const std::function<Status()>& wait) {
  if (at_once > device.max_range()) {
    return unsupported(
        "an image of {}x{} pixels exceeds the storage buffers of the Vulkan device ({} MiB); use a "
        "smaller image or backend 'cpu'",
        image.width, image.height, device.max_range() >> 20);
  }
  if (bytes <= buffer.bytes()) return {};
  STGS_TRY(wait());
  return buffer.ensure(device, bytes, MemoryLocation::kDevice, device.max_range() / 16 * 16);
}

}  // namespace

Status grow_images(const Device& device, std::span<ViewImage> images, const VulkanSubmission* to,
                   const std::function<Status()>& wait) {
  for (std::size_t i = 0; i < images.size(); ++i) {
    ViewImage& p = images[i];
    if (to == nullptr) {
      STGS_TRY(grow(device, p.planes, p.all_plane_bytes(), p, p.plane_bytes(), wait));
      continue;
    }
    const std::uint64_t bytes = pixel_format(to->targets[i].colour.format).bytes * p.pixels();
    STGS_TRY(grow(device, p.packed, bytes, p, bytes, wait));
    if (to->targets[i].depth)
      STGS_TRY(grow(device, p.depth, p.plane_bytes(), p, p.plane_bytes(), wait));
  }
  return {};
}

bool has_fovea(const std::vector<View>& views) {
  return std::any_of(views.begin(), views.end(),
                     [](const View& view) { return view.fovea.has_value(); });
}

FrameInput input_of(const std::vector<View>& views, std::span<const ViewImage> images) {
  static_assert(kMaxFrameViews == kMaxViews);
  FrameInput input{};
  input.views = static_cast<std::uint32_t>(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    ViewInput& view = input.view[i];
    view.camera = views[i].camera;
    view.centre = math::camera_centre(views[i].camera);
    view.background = views[i].background;
    view.width = images[i].width;
    view.height = images[i].height;
    view.tiles_x = tiles_along(images[i].width);
    view.tiles_y = tiles_along(images[i].height);
    view.first_tile = input.tiles;
    const Fovea fovea = fovea_of(views[i]);
    view.fovea = fovea.centre;
    view.fovea_radius = fovea.radius;
    input.tiles += images[i].tiles();
  }
  return input;
}

}  // namespace stgs::player::vulkan
