// SPDX-License-Identifier: Apache-2.0
#include "session.h"

#include <algorithm>
#include <cstring>
#include <string>

namespace xr {
namespace {

constexpr XrViewConfigurationType kStereo = XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO;

template <typename T>
T structure(XrStructureType type) {
  T out{};
  out.type = type;
  return out;
}

void check(XrResult result, const char* operation) {
  if (XR_SUCCEEDED(result)) return;
  throw std::runtime_error(std::string(operation) + ": XrResult " + std::to_string(result));
}

template <typename Function>
Function function_of(XrInstance instance, const char* name) {
  PFN_xrVoidFunction found = nullptr;
  check(xrGetInstanceProcAddr(instance, name, &found), name);
  return reinterpret_cast<Function>(found);
}

}  // namespace

System::System() : System(0) {
  const char* const extension = XR_KHR_VULKAN_ENABLE2_EXTENSION_NAME;
  auto info = structure<XrInstanceCreateInfo>(XR_TYPE_INSTANCE_CREATE_INFO);
  std::strcpy(info.applicationInfo.applicationName, "STGS hello_openxr");
  info.applicationInfo.apiVersion = XR_MAKE_VERSION(1, 0, 0);
  info.enabledExtensionCount = 1;
  info.enabledExtensionNames = &extension;
  if (const XrResult result = xrCreateInstance(&info, &instance); XR_FAILED(result)) {
    instance = XR_NULL_HANDLE;
    throw app::Unsupported("no OpenXR runtime supports " + std::string(extension) + " (XrResult " +
                           std::to_string(result) + ")");
  }
  auto system_info = structure<XrSystemGetInfo>(XR_TYPE_SYSTEM_GET_INFO);
  system_info.formFactor = XR_FORM_FACTOR_HEAD_MOUNTED_DISPLAY;
  if (const XrResult result = xrGetSystem(instance, &system_info, &system); XR_FAILED(result)) {
    throw app::Unsupported("the OpenXR runtime has no headset (XrResult " + std::to_string(result) +
                           ")");
  }
}

System::~System() {
  if (instance != XR_NULL_HANDLE) xrDestroyInstance(instance);
}

app::DeviceFactory System::device_factory() const {
  // The runtime requires this query before it creates anything.
  auto required =
      structure<XrGraphicsRequirementsVulkan2KHR>(XR_TYPE_GRAPHICS_REQUIREMENTS_VULKAN2_KHR);
  check(function_of<PFN_xrGetVulkanGraphicsRequirements2KHR>(
            instance, "xrGetVulkanGraphicsRequirements2KHR")(instance, system, &required),
        "querying the Vulkan requirements of the runtime");
  if (required.minApiVersionSupported > XR_MAKE_VERSION(1, 3, 0)) {
    throw app::Unsupported("the OpenXR runtime requires a later Vulkan version than 1.3");
  }
  app::DeviceFactory factory;
  factory.create_instance = [this](const VkInstanceCreateInfo& vulkan, VkInstance* out) {
    auto info = structure<XrVulkanInstanceCreateInfoKHR>(XR_TYPE_VULKAN_INSTANCE_CREATE_INFO_KHR);
    info.systemId = system;
    info.pfnGetInstanceProcAddr = vkGetInstanceProcAddr;
    info.vulkanCreateInfo = &vulkan;
    VkResult result = VK_ERROR_UNKNOWN;
    check(function_of<PFN_xrCreateVulkanInstanceKHR>(instance, "xrCreateVulkanInstanceKHR")(
              instance, &info, out, &result),
          "creating a Vulkan instance");
    return result;
  };
  factory.choose_device = [this](VkInstance vulkan) {
    auto info =
        structure<XrVulkanGraphicsDeviceGetInfoKHR>(XR_TYPE_VULKAN_GRAPHICS_DEVICE_GET_INFO_KHR);
    info.systemId = system;
    info.vulkanInstance = vulkan;
    VkPhysicalDevice device = VK_NULL_HANDLE;
    check(function_of<PFN_xrGetVulkanGraphicsDevice2KHR>(instance, "xrGetVulkanGraphicsDevice2KHR")(
              instance, &info, &device),
          "querying the Vulkan device of the headset");
    return device;
  };
  factory.create_device = [this](VkPhysicalDevice from, const VkDeviceCreateInfo& vulkan,
                                 VkDevice* out) {
    auto info = structure<XrVulkanDeviceCreateInfoKHR>(XR_TYPE_VULKAN_DEVICE_CREATE_INFO_KHR);
    info.systemId = system;
    info.pfnGetInstanceProcAddr = vkGetInstanceProcAddr;
    info.vulkanPhysicalDevice = from;
    info.vulkanCreateInfo = &vulkan;
    VkResult result = VK_ERROR_UNKNOWN;
    check(function_of<PFN_xrCreateVulkanDeviceKHR>(instance, "xrCreateVulkanDeviceKHR")(
              instance, &info, out, &result),
          "creating a Vulkan device");
    return result;
  };
  return factory;
}

VkExtent2D System::recommended_size() const {
  std::array<XrViewConfigurationView, kEyes> views;
  views.fill(structure<XrViewConfigurationView>(XR_TYPE_VIEW_CONFIGURATION_VIEW));
  std::uint32_t count = 0;
  check(xrEnumerateViewConfigurationViews(instance, system, kStereo, kEyes, &count, views.data()),
        "querying the eyes");
  return {std::max(views[0].recommendedImageRectWidth, views[1].recommendedImageRectWidth),
          std::max(views[0].recommendedImageRectHeight, views[1].recommendedImageRectHeight)};
}

Session::Session(const System& system, const app::Gpu& gpu, VkExtent2D size) : Session(gpu) {
  instance_ = system.instance;
  size_ = size;
  auto binding = structure<XrGraphicsBindingVulkan2KHR>(XR_TYPE_GRAPHICS_BINDING_VULKAN2_KHR);
  binding.instance = gpu.instance;
  binding.physicalDevice = gpu.physical_device;
  binding.device = gpu.device;
  binding.queueFamilyIndex = gpu.queue_family;
  auto info = structure<XrSessionCreateInfo>(XR_TYPE_SESSION_CREATE_INFO);
  info.next = &binding;
  info.systemId = system.system;
  check(xrCreateSession(instance_, &info, &session_), "creating a session");
  auto space = structure<XrReferenceSpaceCreateInfo>(XR_TYPE_REFERENCE_SPACE_CREATE_INFO);
  space.referenceSpaceType = XR_REFERENCE_SPACE_TYPE_LOCAL;
  space.poseInReferenceSpace.orientation.w = 1;
  check(xrCreateReferenceSpace(session_, &space, &space_), "creating a space");
  choose_format();
  for (Swapchain& one : swapchains_) create_swapchain(one);
}

Session::~Session() {
  for (const Swapchain& one : swapchains_) {
    for (const VkImageView view : one.views) vkDestroyImageView(gpu_.device, view, nullptr);
    if (one.handle != XR_NULL_HANDLE) xrDestroySwapchain(one.handle);
  }
  if (space_ != XR_NULL_HANDLE) xrDestroySpace(space_);
  if (session_ != XR_NULL_HANDLE) xrDestroySession(session_);
}

void Session::choose_format() {
  std::uint32_t count = 0;
  check(xrEnumerateSwapchainFormats(session_, 0, &count, nullptr), "counting formats");
  std::vector<std::int64_t> offered(count);
  check(xrEnumerateSwapchainFormats(session_, count, &count, offered.data()), "listing formats");
  const auto offers = [&](VkFormat format) {
    return std::find(offered.begin(), offered.end(), format) != offered.end();
  };
  if (offers(VK_FORMAT_R8G8B8A8_SRGB)) {
    swapchain_format_ = VK_FORMAT_R8G8B8A8_SRGB;
    format_ = VK_FORMAT_R8G8B8A8_UNORM;
  } else if (offers(VK_FORMAT_B8G8R8A8_SRGB)) {
    swapchain_format_ = VK_FORMAT_B8G8R8A8_SRGB;
    format_ = VK_FORMAT_B8G8R8A8_UNORM;
  } else {
    throw app::Unsupported("the OpenXR runtime has no 8-bit sRGB swapchain format");
  }
}

void Session::create_swapchain(Swapchain& to) {
  auto info = structure<XrSwapchainCreateInfo>(XR_TYPE_SWAPCHAIN_CREATE_INFO);
  // Mutable format: the application writes encoded values, the runtime reads them as sRGB.
  info.usageFlags = XR_SWAPCHAIN_USAGE_COLOR_ATTACHMENT_BIT | XR_SWAPCHAIN_USAGE_TRANSFER_SRC_BIT |
                    XR_SWAPCHAIN_USAGE_MUTABLE_FORMAT_BIT;
  info.format = swapchain_format_;
  info.sampleCount = info.faceCount = info.arraySize = info.mipCount = 1;
  info.width = size_.width;
  info.height = size_.height;
  check(xrCreateSwapchain(session_, &info, &to.handle), "creating a swapchain");
  std::uint32_t count = 0;
  check(xrEnumerateSwapchainImages(to.handle, 0, &count, nullptr), "counting images");
  to.images.assign(count,
                   structure<XrSwapchainImageVulkan2KHR>(XR_TYPE_SWAPCHAIN_IMAGE_VULKAN2_KHR));
  check(xrEnumerateSwapchainImages(to.handle, count, &count,
                                   reinterpret_cast<XrSwapchainImageBaseHeader*>(to.images.data())),
        "listing images");
  for (const auto& one : to.images) {
    to.views.push_back(gpu_.create_view(one.image, format_, VK_IMAGE_ASPECT_COLOR_BIT));
  }
}

bool Session::poll() {
  auto event = structure<XrEventDataBuffer>(XR_TYPE_EVENT_DATA_BUFFER);
  while (xrPollEvent(instance_, &event) == XR_SUCCESS) {
    if (event.type == XR_TYPE_EVENT_DATA_SESSION_STATE_CHANGED) {
      change_state(reinterpret_cast<const XrEventDataSessionStateChanged&>(event).state);
    } else if (event.type == XR_TYPE_EVENT_DATA_INSTANCE_LOSS_PENDING) {
      ended_ = true;
    }
    event = structure<XrEventDataBuffer>(XR_TYPE_EVENT_DATA_BUFFER);
  }
  return !ended_;
}

void Session::change_state(XrSessionState state) {
  if (state == XR_SESSION_STATE_READY) {
    auto info = structure<XrSessionBeginInfo>(XR_TYPE_SESSION_BEGIN_INFO);
    info.primaryViewConfigurationType = kStereo;
    check(xrBeginSession(session_, &info), "beginning the session");
    running_ = true;
  } else if (state == XR_SESSION_STATE_FOCUSED) {
    focused_ = true;
  } else if (state == XR_SESSION_STATE_STOPPING) {
    running_ = false;
    check(xrEndSession(session_), "ending the session");
  } else if (state == XR_SESSION_STATE_EXITING || state == XR_SESSION_STATE_LOSS_PENDING) {
    ended_ = true;
  }
}

void Session::request_exit() {
  check(xrRequestExitSession(session_), "requesting the end of the session");
}

Frame Session::begin_frame() {
  auto state = structure<XrFrameState>(XR_TYPE_FRAME_STATE);
  check(xrWaitFrame(session_, nullptr, &state), "waiting for a frame");
  check(xrBeginFrame(session_, nullptr), "beginning a frame");
  Frame frame;
  frame.time = state.predictedDisplayTime;
  if (state.shouldRender == XR_FALSE) return frame;
  auto info = structure<XrViewLocateInfo>(XR_TYPE_VIEW_LOCATE_INFO);
  info.viewConfigurationType = kStereo;
  info.displayTime = frame.time;
  info.space = space_;
  auto found = structure<XrViewState>(XR_TYPE_VIEW_STATE);
  frame.eyes.fill(structure<XrView>(XR_TYPE_VIEW));
  std::uint32_t count = 0;
  check(xrLocateViews(session_, &info, &found, kEyes, &count, frame.eyes.data()),
        "locating the eyes");
  constexpr XrViewStateFlags kKnown =
      XR_VIEW_STATE_ORIENTATION_VALID_BIT | XR_VIEW_STATE_POSITION_VALID_BIT;
  frame.visible = (found.viewStateFlags & kKnown) == kKnown;
  return frame;
}

std::array<EyeImage, kEyes> Session::acquire() {
  std::array<EyeImage, kEyes> out{};
  for (std::size_t i = 0; i < kEyes; ++i) {
    std::uint32_t index = 0;
    check(xrAcquireSwapchainImage(swapchains_[i].handle, nullptr, &index), "acquiring an image");
    auto info = structure<XrSwapchainImageWaitInfo>(XR_TYPE_SWAPCHAIN_IMAGE_WAIT_INFO);
    info.timeout = XR_INFINITE_DURATION;
    check(xrWaitSwapchainImage(swapchains_[i].handle, &info), "waiting for an image");
    out[i] = {swapchains_[i].images[index].image, swapchains_[i].views[index]};
  }
  return out;
}

void Session::release() {
  for (const Swapchain& one : swapchains_) {
    check(xrReleaseSwapchainImage(one.handle, nullptr), "releasing an image");
  }
}

void Session::end_frame(const Frame& frame) {
  std::array<XrCompositionLayerProjectionView, kEyes> views;
  for (std::size_t i = 0; i < kEyes; ++i) {
    views[i] =
        structure<XrCompositionLayerProjectionView>(XR_TYPE_COMPOSITION_LAYER_PROJECTION_VIEW);
    views[i].pose = frame.eyes[i].pose;
    views[i].fov = frame.eyes[i].fov;
    views[i].subImage.swapchain = swapchains_[i].handle;
    views[i].subImage.imageRect.extent = {static_cast<std::int32_t>(size_.width),
                                          static_cast<std::int32_t>(size_.height)};
  }
  auto layer = structure<XrCompositionLayerProjection>(XR_TYPE_COMPOSITION_LAYER_PROJECTION);
  layer.space = space_;
  layer.viewCount = kEyes;
  layer.views = views.data();
  const auto* const layers = reinterpret_cast<const XrCompositionLayerBaseHeader*>(&layer);
  auto info = structure<XrFrameEndInfo>(XR_TYPE_FRAME_END_INFO);
  info.displayTime = frame.time;
  info.environmentBlendMode = XR_ENVIRONMENT_BLEND_MODE_OPAQUE;
  info.layerCount = frame.visible ? 1 : 0;
  info.layers = &layers;
  check(xrEndFrame(session_, &info), "ending a frame");
}

}  // namespace xr
