// SPDX-License-Identifier: Apache-2.0
// The part of OpenXR that an application with two eyes and no controllers needs. One thread at a
// time.
#pragma once

#include "../app/gpu.h"  // first: openxr_platform.h uses Vulkan types

#define XR_USE_GRAPHICS_API_VULKAN
#include <openxr/openxr.h>
#include <openxr/openxr_platform.h>

#include <array>
#include <vector>

namespace xr {

inline constexpr std::size_t kEyes = 2;

// Throws app::Unsupported if there is no runtime or no headset.
class System {
 public:
  System();
  ~System();
  System(const System&) = delete;
  System& operator=(const System&) = delete;

  XrInstance instance = XR_NULL_HANDLE;
  XrSystemId system = XR_NULL_SYSTEM_ID;

  // Returns the factory of a Vulkan device that the runtime can share (XR_KHR_vulkan_enable2).
  app::DeviceFactory device_factory() const;
  // Returns the image size that the runtime recommends, the same for both eyes.
  VkExtent2D recommended_size() const;

 private:
  System(int) {}  // delegated to, so that the destructor runs if a constructor throws
};

// A swapchain image, owned by the application from acquire() to release(), which must leave it as
// COLOR_ATTACHMENT_OPTIMAL.
struct EyeImage {
  VkImage image;
  VkImageView view;  // UNORM: the application writes sRGB-encoded values
};

struct Frame {
  XrTime time = 0;  // predicted display time, nanoseconds on the clock of the runtime
  bool visible = false;
  std::array<XrView, kEyes> eyes{};
};

// The system and the device must outlive the session.
class Session {
 public:
  Session(const System& system, const app::Gpu& gpu, VkExtent2D size);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  VkFormat format() const { return format_; }  // of EyeImage::view
  // Handles events. Returns false once the session has ended.
  bool poll();
  bool running() const { return running_; }  // the runtime expects frames
  bool has_been_focused() const { return focused_; }
  void request_exit();

  // Waits until the runtime expects a frame and begins it. If it is visible, render between
  // acquire() and release(). Always end it.
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
  void create_swapchain(Swapchain& to);
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
