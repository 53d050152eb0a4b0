// SPDX-License-Identifier: Apache-2.0
// Renders on a Vulkan device of the caller: stgs/stgs_vulkan.h.
#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "renderer.h"
#include "scene.h"
#include "stgs/player/vulkan_renderer.h"
#include "stgs/stgs_vulkan.h"
#include "structs.h"
#include "view.h"

static_assert(STGS_VULKAN_MAX_FRAMES_IN_FLIGHT == stgs::player::VulkanRenderer::kMaxFramesInFlight);

using stgs::sdk::check_struct;
using stgs::sdk::copy_in;
using stgs::sdk::copy_out;
using stgs::sdk::guarded;
using stgs::sdk::Outcome;

namespace {

stgs_vulkan_target default_target() {
  stgs_vulkan_target target{};
  target.struct_size = sizeof(target);
  target.colour.final_layout = target.depth.final_layout = VK_IMAGE_LAYOUT_GENERAL;
  return target;
}

// Converts the device for the player. The result points to `enabled`, which must outlive it.
struct EnabledFeatures {
  VkPhysicalDeviceSubgroupSizeControlFeatures sizes{};
  VkPhysicalDeviceTimelineSemaphoreFeatures timeline{};
  VkPhysicalDeviceFeatures2 core{};
};
stgs::player::VulkanDevice device_of(const stgs_vulkan_device& from, EnabledFeatures& enabled) {
  enabled.sizes.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES;
  enabled.sizes.subgroupSizeControl = enabled.sizes.computeFullSubgroups =
      from.subgroup_size_control != 0 ? VK_TRUE : VK_FALSE;
  enabled.timeline.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES;
  enabled.timeline.pNext = &enabled.sizes;
  enabled.timeline.timelineSemaphore = from.timeline_semaphores != 0 ? VK_TRUE : VK_FALSE;
  enabled.core.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
  enabled.core.pNext = &enabled.timeline;
  stgs::player::VulkanDevice device;
  device.get_instance_proc_addr = from.get_instance_proc_addr;
  device.instance = from.instance;
  device.api_version = from.api_version;
  device.physical_device = from.physical_device;
  device.device = from.device;
  device.features = &enabled.core;
  // Ignored where the version of Vulkan includes them.
  device.extensions = {VK_KHR_TIMELINE_SEMAPHORE_EXTENSION_NAME,
                       VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME};
  device.queue_family = from.queue_family;
  device.queue = from.queue;
  const auto calling = [user = from.queue_user](void (*function)(void*)) -> std::function<void()> {
    if (function == nullptr) return {};
    return [=] { function(user); };
  };
  device.lock_queue = calling(from.lock_queue);
  device.unlock_queue = calling(from.unlock_queue);
  return device;
}

Outcome make_on_device(stgs_renderer& renderer, stgs_backend backend,
                       const stgs_vulkan_device* device) {
  stgs_vulkan_device known{};
  STGS_SDK_TRY(copy_in(device, known, "device"));
  if (backend != STGS_BACKEND_AUTO && backend != STGS_BACKEND_VULKAN) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("settings: backend {} cannot use a Vulkan device (expected "
                        "STGS_BACKEND_AUTO or STGS_BACKEND_VULKAN)",
                        backend)};
  }
  EnabledFeatures enabled;
  auto created = stgs::player::make_vulkan_renderer(device_of(known, enabled));
  if (!created.ok()) return created.status();
  renderer.vulkan = created->get();
  renderer.backend = std::move(created).value();
  return {};
}

Outcome check_vulkan(const stgs_renderer& renderer) {
  if (renderer.vulkan != nullptr) return {};
  return {STGS_ERROR_ARGUMENT,
          "the renderer does not use a Vulkan device of the application; create it with "
          "stgs_vulkan_renderer_create"};
}

// A frame with its targets, as structs of this version.
struct KnownFrame {
  stgs_vulkan_frame frame{};
  std::array<stgs_vulkan_target, STGS_MAX_VIEWS> targets;
};
// Checks and copies a frame; the views go to renderer.views.
Outcome copy_in_frame(stgs_renderer& renderer, const stgs_vulkan_frame* given, KnownFrame& known) {
  stgs_vulkan_frame& frame = known.frame;
  STGS_SDK_TRY(copy_in(given, frame, "frame"));
  STGS_SDK_TRY(stgs::sdk::copy_in_views(renderer, frame.views, frame.count));
  if (frame.targets == nullptr) return {STGS_ERROR_ARGUMENT, "targets is NULL"};
  if ((frame.wait == nullptr && frame.wait_count > 0) ||
      (frame.signal == nullptr && frame.signal_count > 0)) {
    return {STGS_ERROR_ARGUMENT, "wait or signal is NULL, but its number of semaphores is not 0"};
  }
  known.targets.fill(default_target());
  STGS_SDK_TRY(stgs::sdk::copy_in_array(frame.targets, std::span(known.targets).first(frame.count),
                                        "targets"));
  frame.targets = known.targets.data();
  return {};
}

stgs::player::VulkanImage image_of(const stgs_vulkan_image& from) {
  return {from.image, from.format, from.width,          from.height,
          from.level, from.layer,  from.initial_layout, from.final_layout};
}

std::vector<stgs::player::VulkanSemaphore> semaphores_of(const stgs_vulkan_semaphore* from,
                                                         std::uint32_t count) {
  std::vector<stgs::player::VulkanSemaphore> out;
  for (std::uint32_t i = 0; i < count; ++i) out.push_back({from[i].semaphore, from[i].value});
  return out;
}

stgs::player::VulkanSubmission submission_of(const stgs_vulkan_frame& frame) {
  stgs::player::VulkanSubmission to;
  for (std::uint32_t i = 0; i < frame.count; ++i) {
    const stgs_vulkan_target& target = frame.targets[i];
    stgs::player::VulkanTarget out;
    out.colour = image_of(target.colour);
    if (target.depth.image != VK_NULL_HANDLE) out.depth = image_of(target.depth);
    to.targets.push_back(out);
  }
  to.wait = semaphores_of(frame.wait, frame.wait_count);
  to.signal = semaphores_of(frame.signal, frame.signal_count);
  return to;
}

}  // namespace

extern "C" {

stgs_result stgs_vulkan_device_defaults(stgs_vulkan_device* device, size_t struct_size) {
  return stgs::sdk::fill_defaults(device, struct_size, stgs_vulkan_device{});
}

stgs_result stgs_vulkan_target_defaults(stgs_vulkan_target* target, size_t struct_size) {
  return stgs::sdk::fill_defaults(target, struct_size, default_target());
}

stgs_result stgs_vulkan_frame_defaults(stgs_vulkan_frame* frame, size_t struct_size) {
  return stgs::sdk::fill_defaults(frame, struct_size, stgs_vulkan_frame{});
}

stgs_result stgs_vulkan_get_support(const stgs_vulkan_device* device,
                                    stgs_vulkan_support* support) {
  stgs_vulkan_device known{};
  if (const stgs_result bad = copy_in(device, known); bad != STGS_OK) return bad;
  if (const stgs_result bad = check_struct(support); bad != STGS_OK) return bad;
  try {
    const auto found = stgs::player::vulkan_support(known.get_instance_proc_addr, known.instance,
                                                    known.api_version, known.physical_device);
    if (!found.ok()) return Outcome(found.status()).result;
    stgs_vulkan_support out{};
    out.struct_size = sizeof(out);
    out.can_render = found->missing_features.empty() ? 1 : 0;
    out.timeline_semaphores = found->timeline_semaphores ? 1 : 0;
    out.subgroup_size_control = found->subgroup_size_control ? 1 : 0;
    out.device_rank = found->rank;
    found->missing_features.copy(out.missing_features, sizeof(out.missing_features) - 1);
    copy_out(support, out);
    return STGS_OK;
  } catch (const std::bad_alloc&) {
    return STGS_ERROR_OUT_OF_MEMORY;
  } catch (...) {
    return STGS_ERROR_RUNTIME;
  }
}

stgs_result stgs_vulkan_renderer_create(const stgs_vulkan_device* device,
                                        const stgs_renderer_settings* settings,
                                        stgs_renderer** out) {
  return stgs::sdk::create_renderer(settings, out,
                                    [=](stgs_renderer& renderer, stgs_backend backend) {
                                      return make_on_device(renderer, backend, device);
                                    });
}

stgs_result stgs_vulkan_submit(stgs_renderer* renderer, stgs_scene* scene, double seconds,
                               const stgs_vulkan_frame* frame, uint64_t* number) {
  return guarded(renderer, [&]() -> Outcome {
    STGS_SDK_TRY(check_vulkan(*renderer));
    STGS_SDK_TRY(stgs::sdk::clamp_time(scene, seconds));
    KnownFrame known;
    STGS_SDK_TRY(copy_in_frame(*renderer, frame, known));
    STGS_SDK_TRY(scene->check_memory(seconds));
    const stgs::ScopedTaskRunner use(renderer->tasks.get());
    const auto submitted = renderer->vulkan->submit(*scene->timeline, seconds, renderer->views,
                                                    submission_of(known.frame));
    scene->log_new_damage();
    if (!submitted.ok()) return submitted.status();
    if (number != nullptr) *number = *submitted;
    return {};
  });
}

stgs_result stgs_vulkan_wait(stgs_renderer* renderer) {
  return guarded(renderer, [&]() -> Outcome {
    STGS_SDK_TRY(check_vulkan(*renderer));
    return renderer->vulkan->wait();
  });
}

stgs_result stgs_vulkan_get_progress(stgs_renderer* renderer, stgs_vulkan_progress* progress) {
  return guarded(renderer, [&]() -> Outcome {
    STGS_SDK_TRY(check_vulkan(*renderer));
    STGS_SDK_TRY(check_struct(progress, "progress"));
    const auto ended = renderer->vulkan->last_completed();
    if (!ended.ok()) return ended.status();
    stgs_vulkan_progress out{};
    out.struct_size = sizeof(out);
    if (ended->number > 0) {
      out.number = ended->number;
      out.complete = ended->complete ? 1 : 0;
      out.active_primitives = ended->stats.active;
      out.splats = ended->stats.splats;
      out.prepare_ms = ended->stats.fetch_ms;
      out.device_ms = ended->stats.device_ms;
      out.slice_ms = ended->stats.slice_ms;
      out.bin_ms = ended->stats.bin_ms;
      out.blend_ms = ended->stats.blend_ms;
      out.pending_primitives = ended->stats.pending;
    }
    copy_out(progress, out);
    return {};
  });
}

}  // extern "C"
