// SPDX-License-Identifier: Apache-2.0
// OpenXR, as much of it as an application with two eyes and no hands needs. One thread.
#pragma once

#include "../app/gpu.h"  // first: OpenXR's header of platforms speaks of Vulkan's types

#define XR_USE_GRAPHICS_API_VULKAN
#include <openxr/openxr.h>
#include <openxr/openxr_platform.h>

#include <array>
#include <vector>

namespace xr {

inline constexpr std::size_t kEyes = 2;

// Throws app::Unsupported where there is no runtime or no headset.
class System {
 public:
  System();
  ~System();
  System(const System&) = delete;
  System& operator=(const System&) = delete;

  XrInstance instance = XR_NULL_HANDLE;
  XrSystemId system = XR_NULL_SYSTEM_ID;

  // How a Vulkan device is made that the runtime can share (XR_KHR_vulkan_enable2).
  app::Makers makers() const;
  // Pixels of a picture that the runtime would like, the same for both eyes.
  VkExtent2D recommended_size() const;

 private:
  System(int) {}  // so that what a constructor has made ends where it throws
};

// A picture that is the application's from acquire() to release(), to be left as
// COLOR_ATTACHMENT_OPTIMAL.
struct EyeImage {
  VkImage image;
  VkImageView view;  // UNORM: what is written is sRGB-encoded, as the runtime reads it
};

struct Frame {
  XrTime time = 0;  // at which it will be seen, nanoseconds of the runtime's clock
  bool visible = false;
  std::array<XrView, kEyes> eyes{};
};

// The system and the device outlive it.
class Session {
 public:
  Session(const System& system, const app::Gpu& gpu, VkExtent2D size);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  VkFormat format() const { return format_; }  // of EyeImage::view
  // What has happened meanwhile; false: the session has ended.
  bool poll();
  bool running() const { return running_; }  // frames are wanted
  bool has_been_focused() const { return focused_; }
  void request_exit();

  // A frame, from when the runtime wants it to its end. Pictures are drawn between acquire() and
  // release() of a visible one.
  Frame begin_frame();
  std::array<EyeImage, kEyes> acquire();
  void release();
  void end_frame(const Frame& frame);

 private:
  struct Swapchain {
    XrSwapchain handle = XR_NULL_HANDLE;
    std::vector<XrSwapchainImageVulkan2KHR> images;
    std::vector<VkImageView> views;
  };
  explicit Session(const app::Gpu& gpu) : gpu_(gpu) {}
  void choose_format();
  void make_swapchain(Swapchain& to);
  void change_state(XrSessionState state);

  const app::Gpu& gpu_;
  XrInstance instance_ = XR_NULL_HANDLE;
  XrSession session_ = XR_NULL_HANDLE;
  XrSpace space_ = XR_NULL_HANDLE;
  VkExtent2D size_{};
  std::int64_t swapchain_format_ = 0;
  VkFormat format_ = VK_FORMAT_UNDEFINED;
  std::array<Swapchain, kEyes> swapchains_;
  bool running_ = false, focused_ = false, ended_ = false;
};

}  // namespace xr
