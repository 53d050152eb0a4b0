// SPDX-License-Identifier: Apache-2.0
// stgs/stgs_vulkan.h in a build without Vulkan. The Vulkan headers are missing, so the structs stay
// incomplete.
#include "renderer.h"

struct stgs_vulkan_device;
struct stgs_vulkan_support;
struct stgs_vulkan_target;
struct stgs_vulkan_frame;
struct stgs_vulkan_progress;

namespace {

stgs::sdk::Outcome not_built() {
  return stgs::not_built(
      "this build of the library has no Vulkan support; build it with libvulkan-dev, "
      "libvulkan-volk-dev and glslc");
}

stgs_result fail(stgs_renderer* renderer) {
  return stgs::sdk::guarded(renderer, not_built);
}

}  // namespace

extern "C" {

STGS_API stgs_result stgs_vulkan_device_defaults(stgs_vulkan_device*, size_t) {
  return STGS_ERROR_NOT_BUILT;
}

STGS_API stgs_result stgs_vulkan_target_defaults(stgs_vulkan_target*, size_t) {
  return STGS_ERROR_NOT_BUILT;
}

STGS_API stgs_result stgs_vulkan_frame_defaults(stgs_vulkan_frame*, size_t) {
  return STGS_ERROR_NOT_BUILT;
}

STGS_API stgs_result stgs_vulkan_get_support(const stgs_vulkan_device*, stgs_vulkan_support*) {
  return STGS_ERROR_NOT_BUILT;
}

STGS_API stgs_result stgs_vulkan_renderer_create(const stgs_vulkan_device*,
                                                 const stgs_renderer_settings* settings,
                                                 stgs_renderer** out) {
  return stgs::sdk::create_renderer(settings, out,
                                    [](stgs_renderer&, stgs_backend) { return not_built(); });
}

STGS_API stgs_result stgs_vulkan_submit(stgs_renderer* renderer, stgs_scene*, double,
                                        const stgs_vulkan_frame*, uint64_t*) {
  return fail(renderer);
}

STGS_API stgs_result stgs_vulkan_wait(stgs_renderer* renderer) {
  return fail(renderer);
}

STGS_API stgs_result stgs_vulkan_get_progress(stgs_renderer* renderer, stgs_vulkan_progress*) {
  return fail(renderer);
}

}  // extern "C"
