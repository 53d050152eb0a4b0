// SPDX-License-Identifier: Apache-2.0
#include "vulkan/device.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <mutex>
#include <vector>

#include "frame_layout.h"
#include "vulkan/pipelines.h"

namespace stgs::player::vulkan {
namespace {

constexpr std::uint32_t kStorageBuffers = kFrameBindings + kStageBindings;
constexpr std::uint32_t kMinSharedBytes = 16384;
// Shared memory of sort_scatter_ballot.comp with 16 lanes: keys and values, positions and digits,
// sums.
constexpr std::uint32_t kBallotSharedBytes = 8 * kSortTile + 2 * 4 * kDigits + 4 * 2 * 16;
static_assert(kBallotSharedBytes == 18560);
constexpr std::uint32_t kOwnVersion = VK_API_VERSION_1_1;  // of an own instance
constexpr std::uint64_t kNoLimit = ~std::uint64_t{0};
// How long to poll a fence before waiting for its interrupt: longer than most frames take.
constexpr std::chrono::milliseconds kPollTime{4};

// Guards volk's instance functions, which are global. They are used only to create devices.
std::mutex volk_mutex;

std::vector<VkQueueFamilyProperties> families_of(VkPhysicalDevice device) {
  std::uint32_t count = 0;
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, families.data());
  return families;
}

// Returns the first requirement that a device does not meet; empty if it meets all.
std::string missing_feature(VkPhysicalDevice device) {
  VkPhysicalDeviceProperties properties{};
  vkGetPhysicalDeviceProperties(device, &properties);
  const VkPhysicalDeviceLimits& limits = properties.limits;
  if (properties.apiVersion < VK_API_VERSION_1_1) return "Vulkan 1.1";
  if (limits.maxComputeWorkGroupInvocations < kGroup ||
      limits.maxComputeWorkGroupSize[0] < kGroup) {
    return fmt::format("workgroups of {} invocations", kGroup);
  }
  if (limits.maxComputeSharedMemorySize < kMinSharedBytes) {
    return fmt::format("{} bytes of shared memory", kMinSharedBytes);
  }
  if (limits.maxPerStageDescriptorStorageBuffers < kStorageBuffers) {
    return fmt::format("{} storage buffers per stage", kStorageBuffers);
  }
  return {};
}

bool computes(const VkQueueFamilyProperties& family) {
  return (family.queueFlags & VK_QUEUE_COMPUTE_BIT) != 0;
}

// Returns the rank of a device by its type: discrete GPUs rank above other GPUs, and those above
// CPU drivers. 0 if the device is not usable.
int rank_of(VkPhysicalDevice device) {
  if (!missing_feature(device).empty()) return 0;
  VkPhysicalDeviceProperties properties{};
  vkGetPhysicalDeviceProperties(device, &properties);
  if (properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU) return 3;
  return properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU ? 1 : 2;
}

// Returns the first compute queue family, or -1.
int family_of(VkPhysicalDevice device) {
  const auto families = families_of(device);
  const auto found = std::find_if(families.begin(), families.end(), computes);
  return found == families.end() ? -1 : static_cast<int>(found - families.begin());
}

// Loads volk's functions for an instance of the caller.
Status load_instance(PFN_vkGetInstanceProcAddr get_instance_proc_addr, VkInstance instance,
                     std::uint32_t api_version) {
  if (api_version < VK_API_VERSION_1_1) {
    return unsupported(
        "the Vulkan instance was created for version {}.{} (VkApplicationInfo::apiVersion); create "
        "it for 1.1 or later",
        VK_API_VERSION_MAJOR(api_version), VK_API_VERSION_MINOR(api_version));
  }
  if (get_instance_proc_addr != nullptr) {
    volkInitializeCustom(get_instance_proc_addr);
  } else if (volkInitialize() != VK_SUCCESS) {
    return unsupported("no Vulkan loader found (libvulkan.so.1)");
  }
  volkLoadInstanceOnly(instance);
  return {};
}

}  // namespace

Status vk_status(VkResult result, const char* action) {
  if (result == VK_SUCCESS) return {};
  std::string message =
      fmt::format("Vulkan failed while {}: VkResult {}", action, static_cast<int>(result));
  if (result == VK_ERROR_OUT_OF_HOST_MEMORY || result == VK_ERROR_OUT_OF_DEVICE_MEMORY) {
    return {StatusCode::kNoMemory, std::move(message)};
  }
  if (result == VK_ERROR_DEVICE_LOST) {
    return {StatusCode::kDeviceLost, message + ": the GPU has failed; create another renderer"};
  }
  return {StatusCode::kRuntime, std::move(message)};
}

Device::~Device() {
  if (context_.device != VK_NULL_HANDLE) {
    if (!borrowed_) vk.vkDeviceWaitIdle(context_.device);
    vk.vkDestroyFence(context_.device, fence_, nullptr);
    vk.vkDestroyCommandPool(context_.device, pool_, nullptr);
    if (!borrowed_) vk.vkDestroyDevice(context_.device, nullptr);
  }
  const bool owns_instance = !borrowed_ && settings_.instance == VK_NULL_HANDLE;
  if (!owns_instance || context_.instance == VK_NULL_HANDLE) return;
  instance_.vkDestroyInstance(context_.instance, nullptr);
}

Status Device::create(const VulkanSettings& settings) {
  settings_ = settings;
  const std::lock_guard lock(volk_mutex);
  STGS_TRY(create_instance());
  STGS_TRY(choose());
  STGS_TRY(open());
  query_limits();
  return create_commands();
}

Status Device::borrow(const VulkanDevice& lent) {
  if (lent.instance == VK_NULL_HANDLE || lent.physical_device == VK_NULL_HANDLE ||
      lent.device == VK_NULL_HANDLE || lent.queue == VK_NULL_HANDLE) {
    return usage_error(
        "a Vulkan device needs an instance, physical device, device and queue; one of them is "
        "null");
  }
  if (static_cast<bool>(lent.lock_queue) != static_cast<bool>(lent.unlock_queue)) {
    return usage_error("lock_queue and unlock_queue must both be set, or neither");
  }
  const std::lock_guard lock(volk_mutex);
  STGS_TRY(load_instance(lent.get_instance_proc_addr, lent.instance, lent.api_version));
  if (const std::string missing = missing_feature(lent.physical_device); !missing.empty()) {
    return unsupported("the Vulkan device cannot be used: it does not support {}", missing);
  }
  const auto families = families_of(lent.physical_device);
  if (lent.queue_family >= families.size() || !computes(families[lent.queue_family])) {
    return usage_error("queue family {} of the Vulkan device does not support compute",
                       lent.queue_family);
  }
  borrowed_ = true;
  context_ = lent;
  features_ = enabled_features(lent);
  context_.features = nullptr;  // valid only during this call
  save_functions();
  volkLoadDeviceTable(&vk, context_.device);
  query_limits();
  return create_commands();
}

void Device::save_functions() {
  instance_.vkGetPhysicalDeviceFormatProperties = vkGetPhysicalDeviceFormatProperties;
  instance_.vkDestroyInstance = vkDestroyInstance;
}

Status Device::create_instance() {
  if (volkInitialize() != VK_SUCCESS) {
    return unsupported("no Vulkan loader found (libvulkan.so.1); use backend 'cpu'");
  }
  context_.instance = settings_.instance;
  if (settings_.instance == VK_NULL_HANDLE) STGS_TRY(create_own_instance());
  volkLoadInstanceOnly(context_.instance);
  save_functions();
  return {};
}

Status Device::create_own_instance() {
  auto application = structure<VkApplicationInfo>(VK_STRUCTURE_TYPE_APPLICATION_INFO);
  application.apiVersion = kOwnVersion;
  auto info = structure<VkInstanceCreateInfo>(VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO);
  info.pApplicationInfo = &application;
  const VkResult result = vkCreateInstance(&info, nullptr, &context_.instance);
  if (result != VK_SUCCESS) context_.instance = VK_NULL_HANDLE;
  if (result == VK_ERROR_INCOMPATIBLE_DRIVER) {
    return unsupported(
        "no Vulkan driver found; install the GPU's driver or mesa-vulkan-drivers, or use backend "
        "'cpu'");
  }
  if (result != VK_SUCCESS) {
    return unsupported("cannot create a Vulkan instance (VkResult {}); use backend 'cpu'",
                       static_cast<int>(result));
  }
  return {};
}

Status Device::choose() {
  std::uint32_t count = 0;
  STGS_TRY(vk_status(vkEnumeratePhysicalDevices(context_.instance, &count, nullptr),
                     "enumerating devices"));
  std::vector<VkPhysicalDevice> devices(count);
  STGS_TRY(vk_status(vkEnumeratePhysicalDevices(context_.instance, &count, devices.data()),
                     "enumerating devices"));
  int best = 0;
  for (const VkPhysicalDevice device : devices) {
    const int family = family_of(device), rank = rank_of(device);
    if (family < 0 || rank <= best) continue;
    best = rank;
    context_.physical_device = device;
    context_.queue_family = static_cast<std::uint32_t>(family);
  }
  if (best > 0) return {};
  return unsupported("no suitable Vulkan device ({} found); use backend 'cpu'", devices.size());
}

Status Device::open() {
  const float priority = 1.0f;
  auto queue = structure<VkDeviceQueueCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO);
  queue.queueFamilyIndex = context_.queue_family;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  auto info = structure<VkDeviceCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO);
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue;
  features_.subgroup_size_control =
      offered_features(context_.physical_device, kOwnVersion).subgroup_size_control;
  auto sizes = structure<VkPhysicalDeviceSubgroupSizeControlFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES);
  sizes.subgroupSizeControl = sizes.computeFullSubgroups = VK_TRUE;
  const char* const extension = VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME;
  if (features_.subgroup_size_control) {
    info.pNext = &sizes;
    info.enabledExtensionCount = 1;
    info.ppEnabledExtensionNames = &extension;
  }
  const VkResult result =
      vkCreateDevice(context_.physical_device, &info, nullptr, &context_.device);
  if (result != VK_SUCCESS) context_.device = VK_NULL_HANDLE;
  STGS_TRY(vk_status(result, "creating a device"));
  volkLoadDeviceTable(&vk, context_.device);
  vk.vkGetDeviceQueue(context_.device, context_.queue_family, 0, &context_.queue);
  return {};
}

void Device::query_limits() {
  auto subgroups = structure<VkPhysicalDeviceSubgroupProperties>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES);
  auto maintenance = structure<VkPhysicalDeviceMaintenance3Properties>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES);
  maintenance.pNext = &subgroups;
  auto properties =
      structure<VkPhysicalDeviceProperties2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2);
  properties.pNext = &maintenance;
  vkGetPhysicalDeviceProperties2(context_.physical_device, &properties);
  vkGetPhysicalDeviceMemoryProperties(context_.physical_device, &memory_);
  const VkPhysicalDeviceLimits& limits = properties.properties.limits;
  runs_on_cpu_ = properties.properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU;
  max_range_ =
      std::min<std::uint64_t>(limits.maxStorageBufferRange, maintenance.maxMemoryAllocationSize);
  if (settings_.range_bytes > 0) max_range_ = std::min(max_range_, settings_.range_bytes);
  subgroups_ = subgroups_of(context_.physical_device, features_);
  constexpr VkSubgroupFeatureFlags kOperations =
      VK_SUBGROUP_FEATURE_BALLOT_BIT | VK_SUBGROUP_FEATURE_SHUFFLE_RELATIVE_BIT;
  const bool ballot = (subgroups.supportedStages & VK_SHADER_STAGE_COMPUTE_BIT) != 0 &&
                      (subgroups.supportedOperations & kOperations) == kOperations &&
                      limits.maxComputeSharedMemorySize >= kBallotSharedBytes;
  if (!ballot || !settings_.use_ballot) subgroups_ = {};
  const std::uint32_t bits =
      families_of(context_.physical_device)[context_.queue_family].timestampValidBits;
  if (bits == 0) return;
  timestamp_ns_ = static_cast<double>(limits.timestampPeriod);
  timestamp_mask_ = bits >= 64 ? kNoLimit : (std::uint64_t{1} << bits) - 1;
}

Status Device::create_commands() {
  auto pool = structure<VkCommandPoolCreateInfo>(VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO);
  pool.queueFamilyIndex = context_.queue_family;
  STGS_TRY(vk_status(vk.vkCreateCommandPool(context_.device, &pool, nullptr, &pool_),
                     "creating a command pool"));
  auto info =
      structure<VkCommandBufferAllocateInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO);
  info.commandPool = pool_;
  info.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
  info.commandBufferCount = 1;
  STGS_TRY(vk_status(vk.vkAllocateCommandBuffers(context_.device, &info, &commands_),
                     "allocating a command buffer"));
  const auto fence = structure<VkFenceCreateInfo>(VK_STRUCTURE_TYPE_FENCE_CREATE_INFO);
  return vk_status(vk.vkCreateFence(context_.device, &fence, nullptr, &fence_), "creating a fence");
}

Status Device::allocate(const VkMemoryRequirements& needs, VkMemoryPropertyFlags properties,
                        VkDeviceMemory* memory) const {
  auto info = structure<VkMemoryAllocateInfo>(VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO);
  info.allocationSize = needs.size;
  for (std::uint32_t i = 0; i < memory_.memoryTypeCount; ++i) {
    if ((needs.memoryTypeBits >> i & 1u) == 0) continue;
    if ((memory_.memoryTypes[i].propertyFlags & properties) != properties) continue;
    info.memoryTypeIndex = i;
    if (vk.vkAllocateMemory(context_.device, &info, nullptr, memory) == VK_SUCCESS) return {};
    *memory = VK_NULL_HANDLE;
  }
  return {StatusCode::kNoMemory,
          fmt::format("out of GPU memory (requested {} MiB)", (needs.size >> 20) + 1)};
}

Status Device::begin(VkCommandBuffer* commands) {
  STGS_TRY(vk_status(vk.vkResetCommandPool(context_.device, pool_, 0), "resetting a command pool"));
  auto info = structure<VkCommandBufferBeginInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO);
  info.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  *commands = commands_;
  return vk_status(vk.vkBeginCommandBuffer(commands_, &info), "beginning a command buffer");
}

Status Device::finish(VkCommandBuffer commands) {
  STGS_TRY(vk_status(vk.vkEndCommandBuffer(commands), "ending a command buffer"));
  auto info = structure<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO);
  info.commandBufferCount = 1;
  info.pCommandBuffers = &commands;
  STGS_TRY(submit({&info, 1}, fence_));
  return wait(fence_);
}

Status Device::submit(std::span<const VkSubmitInfo> batches, VkFence fence) {
  STGS_TRY(vk_status(vk.vkResetFences(context_.device, 1, &fence), "resetting a fence"));
  if (context_.lock_queue) context_.lock_queue();
  const VkResult result = vk.vkQueueSubmit(
      context_.queue, static_cast<std::uint32_t>(batches.size()), batches.data(), fence);
  if (context_.unlock_queue) context_.unlock_queue();
  return vk_status(result, "submitting commands");
}

Status Device::wait(VkFence fence) const {
  // Poll first: the interrupt arrives about 0.1 ms after the frame completes.
  if (!runs_on_cpu_) {
    const auto end = std::chrono::steady_clock::now() + kPollTime;
    do {
      const VkResult result = vk.vkGetFenceStatus(context_.device, fence);
      if (result != VK_NOT_READY) return vk_status(result, "waiting for the device");
    } while (std::chrono::steady_clock::now() < end);
  }
  return vk_status(vk.vkWaitForFences(context_.device, 1, &fence, VK_TRUE, kNoLimit),
                   "waiting for the device");
}

VkFormatFeatureFlags Device::features_of(VkFormat format) const {
  VkFormatProperties properties{};
  instance_.vkGetPhysicalDeviceFormatProperties(context_.physical_device, format, &properties);
  return properties.optimalTilingFeatures;
}

}  // namespace stgs::player::vulkan

namespace stgs::player {

Result<VulkanSupport> vulkan_support(PFN_vkGetInstanceProcAddr get_instance_proc_addr,
                                     VkInstance instance, std::uint32_t api_version,
                                     VkPhysicalDevice physical_device) {
  if (instance == VK_NULL_HANDLE || physical_device == VK_NULL_HANDLE) {
    return usage_error(
        "querying a Vulkan device requires an instance and a physical device; one of them is null");
  }
  const std::lock_guard lock(vulkan::volk_mutex);
  STGS_TRY(vulkan::load_instance(get_instance_proc_addr, instance, api_version));
  const vulkan::Features offered = vulkan::offered_features(physical_device, api_version);
  return VulkanSupport{vulkan::missing_feature(physical_device), offered.timeline_semaphores,
                       offered.subgroup_size_control, vulkan::rank_of(physical_device)};
}

}  // namespace stgs::player
