// SPDX-License-Identifier: Apache-2.0
#include "play/screen.h"

#include <imgui.h>

#include <algorithm>

namespace stgs::tools {
namespace {

constexpr std::uint64_t kNoLimit = ~std::uint64_t{0};
// Nanoseconds for a picture: a window that is covered may give none, and is still to be closed.
constexpr std::uint64_t kPatience = 100'000'000;
constexpr VkImageLayout kDrawn = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL;

}  // namespace

Screen::~Screen() {
  if (handle() == VK_NULL_HANDLE) return;
  vkDeviceWaitIdle(handle());
  drop_targets();
  vkDestroySwapchainKHR(handle(), swapchain_, nullptr);
  for (const Frame& frame : frames_) {
    vkDestroySemaphore(handle(), frame.free, nullptr);
    vkDestroyFence(handle(), frame.ended, nullptr);
    vkDestroyCommandPool(handle(), frame.pool, nullptr);
  }
  for (const VkRenderPass pass : passes_) vkDestroyRenderPass(handle(), pass, nullptr);
}

Status Screen::create(Size size) {
  STGS_TRY(choose_format());
  STGS_TRY(make_passes());
  STGS_TRY(make_frames());
  STGS_TRY(make_swapchain(size));
  const player::VulkanDevice& device = device_.device();
  return painter_.create(device.physical_device, device.device, device.queue_family, device.queue,
                         passes_[0]);
}

// 8 bits as they are: the scene's numbers are encoded as the window expects them.
Status Screen::choose_format() {
  const VkPhysicalDevice physical = device_.device().physical_device;
  std::uint32_t count = 0;
  STGS_TRY(
      vk_status(vkGetPhysicalDeviceSurfaceFormatsKHR(physical, device_.surface(), &count, nullptr),
                "counting the window's formats"));
  std::vector<VkSurfaceFormatKHR> formats(count);
  STGS_TRY(vk_status(
      vkGetPhysicalDeviceSurfaceFormatsKHR(physical, device_.surface(), &count, formats.data()),
      "listing the window's formats"));
  for (const VkFormat wanted : {VK_FORMAT_B8G8R8A8_UNORM, VK_FORMAT_R8G8B8A8_UNORM}) {
    for (const VkSurfaceFormatKHR& one : formats) {
      if (one.format != wanted || one.colorSpace != VK_COLOR_SPACE_SRGB_NONLINEAR_KHR) continue;
      format_ = one;
      return {};
    }
  }
  return unsupported("the window has no format of 8 bits a channel in sRGB");
}

Status Screen::make_passes() {
  for (std::size_t i = 0; i < passes_.size(); ++i) {
    const bool has_scene = i == 1;
    VkAttachmentDescription picture{};
    picture.format = format_.format;
    picture.samples = VK_SAMPLE_COUNT_1_BIT;
    picture.loadOp = has_scene ? VK_ATTACHMENT_LOAD_OP_LOAD : VK_ATTACHMENT_LOAD_OP_CLEAR;
    picture.storeOp = VK_ATTACHMENT_STORE_OP_STORE;
    picture.stencilLoadOp = VK_ATTACHMENT_LOAD_OP_DONT_CARE;
    picture.stencilStoreOp = VK_ATTACHMENT_STORE_OP_DONT_CARE;
    picture.initialLayout = has_scene ? kDrawn : VK_IMAGE_LAYOUT_UNDEFINED;
    picture.finalLayout = kDrawn;
    const VkAttachmentReference attachment{0, kDrawn};
    VkSubpassDescription subpass{};
    subpass.pipelineBindPoint = VK_PIPELINE_BIND_POINT_GRAPHICS;
    subpass.colorAttachmentCount = 1;
    subpass.pColorAttachments = &attachment;
    VkSubpassDependency before{};  // the semaphore's wait, or the scene's copy
    before.srcSubpass = VK_SUBPASS_EXTERNAL;
    before.srcStageMask = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
    before.dstStageMask = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
    before.dstAccessMask =
        VK_ACCESS_COLOR_ATTACHMENT_READ_BIT | VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT;
    auto info = structure<VkRenderPassCreateInfo>(VK_STRUCTURE_TYPE_RENDER_PASS_CREATE_INFO);
    info.attachmentCount = 1;
    info.pAttachments = &picture;
    info.subpassCount = 1;
    info.pSubpasses = &subpass;
    info.dependencyCount = 1;
    info.pDependencies = &before;
    STGS_TRY(vk_status(vkCreateRenderPass(handle(), &info, nullptr, &passes_[i]),
                       "making a render pass"));
  }
  return {};
}

Status Screen::make_frames() {
  for (Frame& frame : frames_) {
    auto pool = structure<VkCommandPoolCreateInfo>(VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO);
    pool.queueFamilyIndex = device_.device().queue_family;
    STGS_TRY(vk_status(vkCreateCommandPool(handle(), &pool, nullptr, &frame.pool),
                       "creating a command pool"));
    auto info =
        structure<VkCommandBufferAllocateInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO);
    info.commandPool = frame.pool;
    info.commandBufferCount = 1;
    STGS_TRY(vk_status(vkAllocateCommandBuffers(handle(), &info, &frame.commands),
                       "creating a command buffer"));
    auto fence = structure<VkFenceCreateInfo>(VK_STRUCTURE_TYPE_FENCE_CREATE_INFO);
    fence.flags = VK_FENCE_CREATE_SIGNALED_BIT;
    STGS_TRY(vk_status(vkCreateFence(handle(), &fence, nullptr, &frame.ended), "making a fence"));
    const auto semaphore =
        structure<VkSemaphoreCreateInfo>(VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO);
    STGS_TRY(vk_status(vkCreateSemaphore(handle(), &semaphore, nullptr, &frame.free),
                       "making a semaphore"));
  }
  return {};
}

Status Screen::make_swapchain(Size size) {
  const player::VulkanDevice& device = device_.device();
  outdated_ = true;  // until there is another
  STGS_TRY(vk_status(vkDeviceWaitIdle(handle()), "waiting for the device"));
  drop_targets();
  VkSurfaceCapabilitiesKHR can{};
  STGS_TRY(vk_status(
      vkGetPhysicalDeviceSurfaceCapabilitiesKHR(device.physical_device, device_.surface(), &can),
      "asking what the window can show"));
  if ((can.supportedUsageFlags & VK_IMAGE_USAGE_TRANSFER_DST_BIT) == 0) {
    return unsupported("the pictures of this window cannot be copied to");
  }
  can_copy_ = (can.supportedUsageFlags & VK_IMAGE_USAGE_TRANSFER_SRC_BIT) != 0;
  extent_ = can.currentExtent;
  if (extent_.width == ~std::uint32_t{0}) {
    extent_.width = std::clamp(static_cast<std::uint32_t>(size.width), can.minImageExtent.width,
                               can.maxImageExtent.width);
    extent_.height = std::clamp(static_cast<std::uint32_t>(size.height), can.minImageExtent.height,
                                can.maxImageExtent.height);
  }
  wanted_ = size;
  if (extent_.width == 0 || extent_.height == 0) return {};  // of no size for now
  const VkSwapchainKHR old = swapchain_;
  auto info = structure<VkSwapchainCreateInfoKHR>(VK_STRUCTURE_TYPE_SWAPCHAIN_CREATE_INFO_KHR);
  info.surface = device_.surface();
  info.minImageCount = can.minImageCount + 1;
  if (can.maxImageCount > 0) info.minImageCount = std::min(info.minImageCount, can.maxImageCount);
  info.imageFormat = format_.format;
  info.imageColorSpace = format_.colorSpace;
  info.imageExtent = extent_;
  info.imageArrayLayers = 1;
  info.imageUsage = VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT |
                    (can_copy_ ? VK_IMAGE_USAGE_TRANSFER_SRC_BIT : 0);
  info.preTransform = can.currentTransform;
  info.compositeAlpha = (can.supportedCompositeAlpha & VK_COMPOSITE_ALPHA_OPAQUE_BIT_KHR) != 0
                            ? VK_COMPOSITE_ALPHA_OPAQUE_BIT_KHR
                            : VK_COMPOSITE_ALPHA_INHERIT_BIT_KHR;
  info.presentMode = VK_PRESENT_MODE_FIFO_KHR;
  info.clipped = VK_TRUE;
  info.oldSwapchain = old;
  const VkResult result = vkCreateSwapchainKHR(handle(), &info, nullptr, &swapchain_);
  if (result != VK_SUCCESS) swapchain_ = VK_NULL_HANDLE;
  vkDestroySwapchainKHR(handle(), old, nullptr);
  if (result == VK_ERROR_OUT_OF_HOST_MEMORY || result == VK_ERROR_OUT_OF_DEVICE_MEMORY) {
    return runtime_error(
        "the Vulkan device has no memory for a window's pictures of {}x{} pixels; "
        "use a smaller --size",
        extent_.width, extent_.height);
  }
  STGS_TRY(vk_status(result, "making the window's pictures"));
  STGS_TRY(make_targets());
  outdated_ = false;
  return {};
}

Status Screen::make_targets() {
  std::uint32_t count = 0;
  STGS_TRY(vk_status(vkGetSwapchainImagesKHR(handle(), swapchain_, &count, nullptr),
                     "counting the window's pictures"));
  std::vector<VkImage> images(count);
  STGS_TRY(vk_status(vkGetSwapchainImagesKHR(handle(), swapchain_, &count, images.data()),
                     "listing the window's pictures"));
  targets_.resize(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    Target& target = targets_[i];
    target.image = images[i];
    auto view = structure<VkImageViewCreateInfo>(VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO);
    view.image = target.image;
    view.viewType = VK_IMAGE_VIEW_TYPE_2D;
    view.format = format_.format;
    view.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
    STGS_TRY(vk_status(vkCreateImageView(handle(), &view, nullptr, &target.view), "making a view"));
    auto info = structure<VkFramebufferCreateInfo>(VK_STRUCTURE_TYPE_FRAMEBUFFER_CREATE_INFO);
    info.renderPass = passes_[0];
    info.attachmentCount = 1;
    info.pAttachments = &target.view;
    info.width = extent_.width;
    info.height = extent_.height;
    info.layers = 1;
    STGS_TRY(vk_status(vkCreateFramebuffer(handle(), &info, nullptr, &target.framebuffer),
                       "making a framebuffer"));
    const auto semaphore =
        structure<VkSemaphoreCreateInfo>(VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO);
    STGS_TRY(vk_status(vkCreateSemaphore(handle(), &semaphore, nullptr, &target.drawn),
                       "making a semaphore"));
  }
  return {};
}

void Screen::drop_targets() {
  for (const Target& target : targets_) {
    vkDestroySemaphore(handle(), target.drawn, nullptr);
    vkDestroyFramebuffer(handle(), target.framebuffer, nullptr);
    vkDestroyImageView(handle(), target.view, nullptr);
  }
  targets_.clear();
}

Result<std::optional<Screen::Picture>> Screen::begin(Size size) {
  if (outdated_ || size.width != wanted_.width || size.height != wanted_.height) {
    STGS_TRY(make_swapchain(size));
    if (outdated_) return std::optional<Picture>();
  }
  const Frame& frame = frames_[number_ % frames_.size()];
  const VkResult ended = vkWaitForFences(handle(), 1, &frame.ended, VK_TRUE, kPatience);
  if (ended == VK_TIMEOUT) return std::optional<Picture>();
  STGS_TRY(vk_status(ended, "waiting for a picture"));
  const VkResult result =
      vkAcquireNextImageKHR(handle(), swapchain_, kPatience, frame.free, VK_NULL_HANDLE, &current_);
  if (result == VK_TIMEOUT || result == VK_NOT_READY) return std::optional<Picture>();
  if (result == VK_ERROR_OUT_OF_DATE_KHR) {
    outdated_ = true;
    return std::optional<Picture>();
  }
  // One that no longer fits the window well is shown, and the next is another.
  if (result == VK_SUBOPTIMAL_KHR) {
    outdated_ = true;
  } else {
    STGS_TRY(vk_status(result, "taking a picture of the window"));
  }
  Picture picture;
  picture.image.image = targets_[current_].image;
  picture.image.format = format_.format;
  picture.image.width = extent_.width;
  picture.image.height = extent_.height;
  picture.image.after = kDrawn;
  picture.free = frame.free;
  return std::optional<Picture>(picture);
}

Status Screen::record(const ImDrawData& list, bool has_scene, bool copied) {
  const Frame& frame = frames_[number_ % frames_.size()];
  STGS_TRY(vk_status(vkResetCommandPool(handle(), frame.pool, 0), "resetting commands"));
  auto begin = structure<VkCommandBufferBeginInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO);
  begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  STGS_TRY(vk_status(vkBeginCommandBuffer(frame.commands, &begin), "beginning commands"));
  const VkClearValue black{{{0, 0, 0, 1}}};
  auto pass = structure<VkRenderPassBeginInfo>(VK_STRUCTURE_TYPE_RENDER_PASS_BEGIN_INFO);
  pass.renderPass = passes_[has_scene ? 1 : 0];
  pass.framebuffer = targets_[current_].framebuffer;
  pass.renderArea.extent = extent_;
  pass.clearValueCount = 1;
  pass.pClearValues = &black;
  vkCmdBeginRenderPass(frame.commands, &pass, VK_SUBPASS_CONTENTS_INLINE);
  STGS_TRY(painter_.draw(list, number_, frame.commands));
  vkCmdEndRenderPass(frame.commands);
  auto change = structure<VkImageMemoryBarrier>(VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER);
  change.srcAccessMask = VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT;
  change.oldLayout = kDrawn;
  change.newLayout = VK_IMAGE_LAYOUT_PRESENT_SRC_KHR;
  change.srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  change.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  change.image = targets_[current_].image;
  change.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
  VkPipelineStageFlags before = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
  if (copied) {
    change.dstAccessMask = VK_ACCESS_TRANSFER_READ_BIT;
    change.newLayout = VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL;
    vkCmdPipelineBarrier(frame.commands, before, VK_PIPELINE_STAGE_TRANSFER_BIT, 0, 0, nullptr, 0,
                         nullptr, 1, &change);
    record_copy(frame.commands);
    before = VK_PIPELINE_STAGE_TRANSFER_BIT;
    change.srcAccessMask = 0;
    change.dstAccessMask = 0;
    change.oldLayout = VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL;
    change.newLayout = VK_IMAGE_LAYOUT_PRESENT_SRC_KHR;
  }
  vkCmdPipelineBarrier(frame.commands, before, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, 0, 0, nullptr,
                       0, nullptr, 1, &change);
  return vk_status(vkEndCommandBuffer(frame.commands), "ending commands");
}

void Screen::record_copy(VkCommandBuffer commands) const {
  VkBufferImageCopy region{};
  region.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1};
  region.imageExtent = {extent_.width, extent_.height, 1};
  vkCmdCopyImageToBuffer(commands, targets_[current_].image, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL,
                         copy_.handle(), 1, &region);
  auto done = structure<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  done.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
  done.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
  vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1,
                       &done, 0, nullptr, 0, nullptr);
}

encoder::Image8 Screen::copied() const {
  encoder::Image8 picture;
  picture.width = static_cast<int>(extent_.width);
  picture.height = static_cast<int>(extent_.height);
  picture.channels = 3;
  const std::size_t pixels = std::size_t{extent_.width} * extent_.height;
  picture.data.resize(3 * pixels);
  const bool red_first = format_.format == VK_FORMAT_R8G8B8A8_UNORM;
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      picture.data[3 * i + c] = copy_.data()[4 * i + (red_first ? c : 2 - c)];
    }
  }
  return picture;
}

Status Screen::end(const ImDrawData& list, bool has_scene, encoder::Image8* copy) {
  const player::VulkanDevice& device = device_.device();
  if (copy != nullptr) {
    if (!can_copy_) return unsupported("the pictures of this window cannot be copied from");
    STGS_TRY(copy_.ensure(device.physical_device, device.device, VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                          std::uint64_t{4} * extent_.width * extent_.height));
  }
  STGS_TRY(record(list, has_scene, copy != nullptr));
  const Frame& frame = frames_[number_ % frames_.size()];
  const VkPipelineStageFlags stage = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
  auto submit = structure<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO);
  submit.waitSemaphoreCount = has_scene ? 0 : 1;  // else the scene has waited for it
  submit.pWaitSemaphores = &frame.free;
  submit.pWaitDstStageMask = &stage;
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &frame.commands;
  submit.signalSemaphoreCount = 1;
  submit.pSignalSemaphores = &targets_[current_].drawn;
  STGS_TRY(vk_status(vkResetFences(handle(), 1, &frame.ended), "resetting a fence"));
  STGS_TRY(vk_status(vkQueueSubmit(device.queue, 1, &submit, frame.ended), "starting commands"));
  auto present = structure<VkPresentInfoKHR>(VK_STRUCTURE_TYPE_PRESENT_INFO_KHR);
  present.waitSemaphoreCount = 1;
  present.pWaitSemaphores = &targets_[current_].drawn;
  present.swapchainCount = 1;
  present.pSwapchains = &swapchain_;
  present.pImageIndices = &current_;
  const VkResult result = vkQueuePresentKHR(device.queue, &present);
  ++number_;
  if (copy != nullptr) {
    STGS_TRY(vk_status(vkWaitForFences(handle(), 1, &frame.ended, VK_TRUE, kNoLimit),
                       "waiting for a picture"));
    *copy = copied();
  }
  if (result == VK_ERROR_OUT_OF_DATE_KHR || result == VK_SUBOPTIMAL_KHR) {
    outdated_ = true;
    return {};
  }
  return vk_status(result, "showing a picture");
}

}  // namespace stgs::tools
