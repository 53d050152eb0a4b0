// SPDX-License-Identifier: Apache-2.0
#include "vulkan/caller_images.h"

#include <cmath>

#include "frame_layout.h"

namespace stgs::player::vulkan {
namespace {

Status check_image(const Device& device, const View& view, const VulkanImage& image,
                   std::size_t number, const char* kind, bool is_supported_format) {
  const auto width = static_cast<std::uint32_t>(std::lround(view.camera.width));
  const auto height = static_cast<std::uint32_t>(std::lround(view.camera.height));
  if (image.image == VK_NULL_HANDLE) {
    return usage_error("the {} image of view {} is missing", kind, number);
  }
  if (image.width != width || image.height != height) {
    return usage_error(
        "the {} image of view {} has the wrong size (expected {}x{} pixels, got {}x{})", kind,
        number, width, height, image.width, image.height);
  }
  if (!is_supported_format) {
    return usage_error(
        "the {} image of view {} has an unsupported format (VkFormat {}); the header that declares "
        "the image lists the supported formats",
        kind, number, static_cast<int>(image.format));
  }
  if ((device.features_of(image.format) & VK_FORMAT_FEATURE_TRANSFER_DST_BIT) == 0) {
    return unsupported("the Vulkan device cannot copy into images of VkFormat {}",
                       static_cast<int>(image.format));
  }
  if (image.final_layout == VK_IMAGE_LAYOUT_UNDEFINED ||
      image.final_layout == VK_IMAGE_LAYOUT_PREINITIALIZED) {
    return usage_error(
        "the final layout of the {} image of view {} must not be undefined or preinitialized", kind,
        number);
  }
  return {};
}

Status check_semaphores(const Device& device, const std::vector<VulkanSemaphore>& semaphores) {
  for (const VulkanSemaphore& one : semaphores) {
    if (one.semaphore == VK_NULL_HANDLE) return usage_error("a Vulkan semaphore is missing");
    if (one.value > 0 && !device.features().timeline_semaphores) {
      return unsupported(
          "the Vulkan device was created without timeline semaphores; enable the feature "
          "timelineSemaphore (before Vulkan 1.2 also the extension VK_KHR_timeline_semaphore), and "
          "list it in the device description");
    }
  }
  return {};
}

// Records the layout transition of the level and layer before or after the copy. Synchronises with
// all earlier and later commands.
void change_layout(const Device& device, VkCommandBuffer commands, const VulkanImage& image,
                   bool to_copy) {
  auto change = structure<VkImageMemoryBarrier>(VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER);
  constexpr VkAccessFlags kAll = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT;
  change.srcAccessMask = to_copy ? kAll : VkAccessFlags{VK_ACCESS_TRANSFER_WRITE_BIT};
  change.dstAccessMask = to_copy ? VkAccessFlags{VK_ACCESS_TRANSFER_WRITE_BIT} : kAll;
  change.oldLayout = to_copy ? image.initial_layout : VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
  change.newLayout = to_copy ? VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL : image.final_layout;
  change.srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  change.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  change.image = image.image;
  change.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, image.level, 1, image.layer, 1};
  const VkPipelineStageFlags copy = VK_PIPELINE_STAGE_TRANSFER_BIT,
                             all = VK_PIPELINE_STAGE_ALL_COMMANDS_BIT;
  device.vk.vkCmdPipelineBarrier(commands, to_copy ? all : copy, to_copy ? copy : all, 0, 0,
                                 nullptr, 0, nullptr, 1, &change);
}

}  // namespace

PixelFormat pixel_format(VkFormat format) {
  switch (format) {
    case VK_FORMAT_R8G8B8A8_UNORM:
    case VK_FORMAT_R8G8B8A8_SRGB:
      return {kPixelRgba8, 4};
    case VK_FORMAT_B8G8R8A8_UNORM:
    case VK_FORMAT_B8G8R8A8_SRGB:
      return {kPixelBgra8, 4};
    case VK_FORMAT_A2B10G10R10_UNORM_PACK32:
      return {kPixelRgb10, 4};
    case VK_FORMAT_R16G16B16A16_SFLOAT:
      return {kPixelRgba16, 8};
    case VK_FORMAT_R32G32B32A32_SFLOAT:
      return {kPixelRgba32, 16};
    default:
      return {kPixelPlanes, 0};
  }
}

Status check_submission(const Device& device, const std::vector<View>& views,
                        const VulkanSubmission& to) {
  if (to.targets.size() != views.size()) {
    return usage_error("expected {} targets (one per view), got {}", views.size(),
                       to.targets.size());
  }
  for (std::size_t i = 0; i < views.size(); ++i) {
    const VulkanTarget& target = to.targets[i];
    STGS_TRY(check_image(device, views[i], target.colour, i, "colour",
                         pixel_format(target.colour.format).bytes > 0));
    if (!target.depth) continue;
    STGS_TRY(check_image(device, views[i], *target.depth, i, "depth",
                         target.depth->format == VK_FORMAT_R32_SFLOAT));
  }
  STGS_TRY(check_semaphores(device, to.wait));
  return check_semaphores(device, to.signal);
}

void copy_to_image(const Device& device, VkBuffer from, const VulkanImage& image,
                   VkCommandBuffer commands) {
  change_layout(device, commands, image, true);
  VkBufferImageCopy region{};
  region.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, image.level, image.layer, 1};
  region.imageExtent = {image.width, image.height, 1};
  device.vk.vkCmdCopyBufferToImage(commands, from, image.image,
                                   VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1, &region);
  change_layout(device, commands, image, false);
}

}  // namespace stgs::player::vulkan
