// SPDX-License-Identifier: Apache-2.0
#include "play/screen.h"

#include <imgui.h>

#include <algorithm>

namespace stgs::tools {
namespace {

constexpr std::uint64_t kNoLimit = ~std::uint64_t{0};
// Nanoseconds to wait for an image. A covered window may return none and must still react to close.
constexpr std::uint64_t kImageTimeout = 100'000'000;
constexpr VkImageLayout kRendered = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL;

}  // namespace

Screen::~Screen() {
  if (handle() == VK_NULL_HANDLE) return;
  vkDeviceWaitIdle(handle());
  destroy_targets();
  vkDestroySwapchainKHR(handle(), swapchain_, nullptr);
  for (const Frame& frame : frames_) {
    vkDestroySemaphore(handle(), frame.acquired, nullptr);
    vkDestroyFence(handle(), frame.completed, nullptr);
    vkDestroyCommandPool(handle(), frame.pool, nullptr);
  }
  for (const VkRenderPass pass : passes_) vkDestroyRenderPass(handle(), pass, nullptr);
}

Status Screen::create(Size size) {
  STGS_TRY(choose_format());
  STGS_TRY(make_passes());
  STGS_TRY(make_frames());
  STGS_TRY(make_swapchain(size));
  return painter_.create(device_.device(), passes_[0]);
}

// Chooses an 8-bit UNORM format: the colours of the scene are sRGB-encoded already.
Status Screen::choose_format() {
  const VkPhysicalDevice physical = device_.device().physical_device;
  std::uint32_t count = 0;
  STGS_TRY(
      vk_status(vkGetPhysicalDeviceSurfaceFormatsKHR(physical, device_.surface(), &count, nullptr),
                "counting the surface formats"));
  std::vector<VkSurfaceFormatKHR> formats(count);
  STGS_TRY(vk_status(
      vkGetPhysicalDeviceSurfaceFormatsKHR(physical, device_.surface(), &count, formats.data()),
      "listing the surface formats"));
  for (const VkFormat format : {VK_FORMAT_B8G8R8A8_UNORM, VK_FORMAT_R8G8B8A8_UNORM}) {
    for (const VkSurfaceFormatKHR& offered : formats) {
      if (offered.format != format || offered.colorSpace != VK_COLOR_SPACE_SRGB_NONLINEAR_KHR)
        continue;
      format_ = offered;
      return {};
    }
  }
  return unsupported("the window has no sRGB format with 8 bits per channel");
}

Status Screen::make_passes() {
  for (std::size_t i = 0; i < passes_.size(); ++i) {
    const bool has_scene = i == 1;
    VkAttachmentDescription colour{};
    colour.format = format_.format;
    colour.samples = VK_SAMPLE_COUNT_1_BIT;
    colour.loadOp = has_scene ? VK_ATTACHMENT_LOAD_OP_LOAD : VK_ATTACHMENT_LOAD_OP_CLEAR;
    colour.storeOp = VK_ATTACHMENT_STORE_OP_STORE;
    colour.stencilLoadOp = VK_ATTACHMENT_LOAD_OP_DONT_CARE;
    colour.stencilStoreOp = VK_ATTACHMENT_STORE_OP_DONT_CARE;
    colour.initialLayout = has_scene ? kRendered : VK_IMAGE_LAYOUT_UNDEFINED;
    colour.finalLayout = kRendered;
    const VkAttachmentReference attachment{0, kRendered};
    VkSubpassDescription subpass{};
    subpass.pipelineBindPoint = VK_PIPELINE_BIND_POINT_GRAPHICS;
    subpass.colorAttachmentCount = 1;
    subpass.pColorAttachments = &attachment;
    VkSubpassDependency before{};  // on the semaphore wait, or on the copy of the scene
    before.srcSubpass = VK_SUBPASS_EXTERNAL;
    before.srcStageMask = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
    before.dstStageMask = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
    before.dstAccessMask =
        VK_ACCESS_COLOR_ATTACHMENT_READ_BIT | VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT;
    auto info = structure<VkRenderPassCreateInfo>(VK_STRUCTURE_TYPE_RENDER_PASS_CREATE_INFO);
    info.attachmentCount = 1;
    info.pAttachments = &colour;
    info.subpassCount = 1;
    info.pSubpasses = &subpass;
    info.dependencyCount = 1;
    info.pDependencies = &before;
    STGS_TRY(vk_status(vkCreateRenderPass(handle(), &info, nullptr, &passes_[i]),
                       "creating a render pass"));
  }
  return {};
}

Status Screen::make_frames() {
  for (Frame& frame : frames_) {
    STGS_TRY(make_commands(device_.device(), &frame.pool, &frame.commands));
    auto fence = structure<VkFenceCreateInfo>(VK_STRUCTURE_TYPE_FENCE_CREATE_INFO);
    fence.flags = VK_FENCE_CREATE_SIGNALED_BIT;
    STGS_TRY(
        vk_status(vkCreateFence(handle(), &fence, nullptr, &frame.completed), "creating a fence"));
    const auto semaphore =
        structure<VkSemaphoreCreateInfo>(VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO);
    STGS_TRY(vk_status(vkCreateSemaphore(handle(), &semaphore, nullptr, &frame.acquired),
                       "creating a semaphore"));
  }
  return {};
}

Status Screen::make_swapchain(Size size) {
  const DeviceHandles& device = device_.device();
  outdated_ = true;  // until the new swapchain exists
  STGS_TRY(vk_status(vkDeviceWaitIdle(handle()), "waiting for the device"));
  destroy_targets();
  VkSurfaceCapabilitiesKHR surface{};
  STGS_TRY(vk_status(vkGetPhysicalDeviceSurfaceCapabilitiesKHR(device.physical_device,
                                                               device_.surface(), &surface),
                     "querying the surface capabilities"));
  if ((surface.supportedUsageFlags & VK_IMAGE_USAGE_TRANSFER_DST_BIT) == 0) {
    return unsupported("the images of this window cannot be copied to");
  }
  can_copy_ = (surface.supportedUsageFlags & VK_IMAGE_USAGE_TRANSFER_SRC_BIT) != 0;
  extent_ = surface.currentExtent;
  if (extent_.width == ~std::uint32_t{0}) {
    extent_.width = std::clamp(static_cast<std::uint32_t>(size.width), surface.minImageExtent.width,
                               surface.maxImageExtent.width);
    extent_.height = std::clamp(static_cast<std::uint32_t>(size.height),
                                surface.minImageExtent.height, surface.maxImageExtent.height);
  }
  requested_ = size;
  if (extent_.width == 0 || extent_.height == 0) return {};  // the window has no area for now
  const VkSwapchainKHR old = swapchain_;
  auto info = structure<VkSwapchainCreateInfoKHR>(VK_STRUCTURE_TYPE_SWAPCHAIN_CREATE_INFO_KHR);
  info.surface = device_.surface();
  info.minImageCount = surface.minImageCount + 1;
  if (surface.maxImageCount > 0)
    info.minImageCount = std::min(info.minImageCount, surface.maxImageCount);
  info.imageFormat = format_.format;
  info.imageColorSpace = format_.colorSpace;
  info.imageExtent = extent_;
  info.imageArrayLayers = 1;
  info.imageUsage = VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT |
                    (can_copy_ ? VK_IMAGE_USAGE_TRANSFER_SRC_BIT : 0);
  info.preTransform = surface.currentTransform;
  info.compositeAlpha = (surface.supportedCompositeAlpha & VK_COMPOSITE_ALPHA_OPAQUE_BIT_KHR) != 0
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
        "the Vulkan device has no memory for window images of {}x{} pixels; use a smaller --size",
        extent_.width, extent_.height);
  }
  STGS_TRY(vk_status(result, "creating the swapchain"));
  STGS_TRY(make_targets());
  outdated_ = false;
  return {};
}

Status Screen::make_targets() {
  std::uint32_t count = 0;
  STGS_TRY(vk_status(vkGetSwapchainImagesKHR(handle(), swapchain_, &count, nullptr),
                     "counting the swapchain images"));
  std::vector<VkImage> images(count);
  STGS_TRY(vk_status(vkGetSwapchainImagesKHR(handle(), swapchain_, &count, images.data()),
                     "listing the swapchain images"));
  targets_.resize(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    Target& target = targets_[i];
    target.image = images[i];
    STGS_TRY(make_view(handle(), target.image, format_.format, &target.view));
    auto info = structure<VkFramebufferCreateInfo>(VK_STRUCTURE_TYPE_FRAMEBUFFER_CREATE_INFO);
    info.renderPass = passes_[0];
    info.attachmentCount = 1;
    info.pAttachments = &target.view;
    info.width = extent_.width;
    info.height = extent_.height;
    info.layers = 1;
    STGS_TRY(vk_status(vkCreateFramebuffer(handle(), &info, nullptr, &target.framebuffer),
                       "creating a framebuffer"));
    const auto semaphore =
        structure<VkSemaphoreCreateInfo>(VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO);
    STGS_TRY(vk_status(vkCreateSemaphore(handle(), &semaphore, nullptr, &target.rendered),
                       "creating a semaphore"));
  }
  return {};
}

void Screen::destroy_targets() {
  for (const Target& target : targets_) {
    vkDestroySemaphore(handle(), target.rendered, nullptr);
    vkDestroyFramebuffer(handle(), target.framebuffer, nullptr);
    vkDestroyImageView(handle(), target.view, nullptr);
  }
  targets_.clear();
}

Result<std::optional<Screen::Acquired>> Screen::begin(Size size) {
  if (outdated_ || size.width != requested_.width || size.height != requested_.height) {
    STGS_TRY(make_swapchain(size));
    if (outdated_) return std::optional<Acquired>();
  }
  const Frame& frame = frames_[number_ % frames_.size()];
  const VkResult waited = vkWaitForFences(handle(), 1, &frame.completed, VK_TRUE, kImageTimeout);
  if (waited == VK_TIMEOUT) return std::optional<Acquired>();
  STGS_TRY(vk_status(waited, "waiting for a frame"));
  const VkResult result = vkAcquireNextImageKHR(handle(), swapchain_, kImageTimeout, frame.acquired,
                                                VK_NULL_HANDLE, &current_);
  if (result == VK_TIMEOUT || result == VK_NOT_READY) return std::optional<Acquired>();
  if (result == VK_ERROR_OUT_OF_DATE_KHR) {
    outdated_ = true;
    return std::optional<Acquired>();
  }
  // A suboptimal image is still presented; the next frame gets a new swapchain.
  if (result == VK_SUBOPTIMAL_KHR) {
    outdated_ = true;
  } else {
    STGS_TRY(vk_status(result, "acquiring an image"));
  }
  Acquired next;
  next.image.image = targets_[current_].image;
  next.image.format = format_.format;
  next.image.width = extent_.width;
  next.image.height = extent_.height;
  next.image.final_layout = kRendered;
  next.acquired = frame.acquired;
  return std::optional<Acquired>(next);
}

Status Screen::record(const ImDrawData& list, bool has_scene, bool copied) {
  const Frame& frame = frames_[number_ % frames_.size()];
  STGS_TRY(vk_status(vkResetCommandPool(handle(), frame.pool, 0), "resetting a command pool"));
  STGS_TRY(begin_commands(frame.commands));
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
  VkImageMemoryBarrier change = image_barrier(targets_[current_].image);
  change.srcAccessMask = VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT;
  change.oldLayout = kRendered;
  change.newLayout = VK_IMAGE_LAYOUT_PRESENT_SRC_KHR;
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
  return vk_status(vkEndCommandBuffer(frame.commands), "ending a command buffer");
}

void Screen::record_copy(VkCommandBuffer commands) const {
  const VkBufferImageCopy region = whole_image(extent_.width, extent_.height);
  vkCmdCopyImageToBuffer(commands, targets_[current_].image, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL,
                         copy_.handle(), 1, &region);
  auto done = structure<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  done.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
  done.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
  vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1,
                       &done, 0, nullptr, 0, nullptr);
}

encoder::Image8 Screen::copied() const {
  encoder::Image8 image;
  image.width = static_cast<int>(extent_.width);
  image.height = static_cast<int>(extent_.height);
  image.channels = 3;
  const std::size_t pixels = std::size_t{extent_.width} * extent_.height;
  image.data.resize(3 * pixels);
  const bool red_first = format_.format == VK_FORMAT_R8G8B8A8_UNORM;
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      image.data[3 * i + c] = copy_.data()[4 * i + (red_first ? c : 2 - c)];
    }
  }
  return image;
}

Status Screen::end(const ImDrawData& list, bool has_scene, encoder::Image8* copy) {
  const DeviceHandles& device = device_.device();
  if (copy != nullptr) {
    if (!can_copy_) return unsupported("the images of this window cannot be copied from");
    STGS_TRY(copy_.ensure(device, VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                          std::uint64_t{4} * extent_.width * extent_.height));
  }
  STGS_TRY(record(list, has_scene, copy != nullptr));
  const Frame& frame = frames_[number_ % frames_.size()];
  const VkPipelineStageFlags stage = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
  auto submit = structure<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO);
  submit.waitSemaphoreCount = has_scene ? 0 : 1;  // the scene has waited already
  submit.pWaitSemaphores = &frame.acquired;
  submit.pWaitDstStageMask = &stage;
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &frame.commands;
  submit.signalSemaphoreCount = 1;
  submit.pSignalSemaphores = &targets_[current_].rendered;
  STGS_TRY(vk_status(vkResetFences(handle(), 1, &frame.completed), "resetting a fence"));
  STGS_TRY(
      vk_status(vkQueueSubmit(device.queue, 1, &submit, frame.completed), "submitting commands"));
  auto present = structure<VkPresentInfoKHR>(VK_STRUCTURE_TYPE_PRESENT_INFO_KHR);
  present.waitSemaphoreCount = 1;
  present.pWaitSemaphores = &targets_[current_].rendered;
  present.swapchainCount = 1;
  present.pSwapchains = &swapchain_;
  present.pImageIndices = &current_;
  const VkResult result = vkQueuePresentKHR(device.queue, &present);
  ++number_;
  if (copy != nullptr) {
    STGS_TRY(vk_status(vkWaitForFences(handle(), 1, &frame.completed, VK_TRUE, kNoLimit),
                       "waiting for a frame"));
    *copy = copied();
  }
  if (result == VK_ERROR_OUT_OF_DATE_KHR || result == VK_SUBOPTIMAL_KHR) {
    outdated_ = true;
    return {};
  }
  return vk_status(result, "presenting an image");
}

}  // namespace stgs::tools
