// SPDX-License-Identifier: Apache-2.0
#include "vulkan_compute.h"

#include <fmt/format.h>
#include <volk.h>

#include <cstring>

#include "stgs/player/vulkan_instance.h"

namespace stgs::test {
namespace {

// Returns a zeroed Vulkan structure with its sType set.
template <class T>
T structure(VkStructureType type) {
  T info{};
  info.sType = type;
  return info;
}

int compute_family(VkPhysicalDevice device) {
  std::uint32_t count = 0;
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, families.data());
  for (std::uint32_t i = 0; i < count; ++i) {
    if (families[i].queueFlags & VK_QUEUE_COMPUTE_BIT) return static_cast<int>(i);
  }
  return -1;
}

struct Buffer {
  VkBuffer buffer = VK_NULL_HANDLE;
  VkDeviceMemory memory = VK_NULL_HANDLE;
  void* mapped = nullptr;
};

// The Vulkan objects of one run; the destructor destroys them.
struct Run {
  VkPhysicalDevice physical = VK_NULL_HANDLE;
  std::uint32_t family = 0;
  VkDevice device = VK_NULL_HANDLE;
  VkQueue queue = VK_NULL_HANDLE;
  Buffer buffers[2];
  VkDescriptorSetLayout set_layout = VK_NULL_HANDLE;
  VkPipelineLayout layout = VK_NULL_HANDLE;
  VkShaderModule shader = VK_NULL_HANDLE;
  VkPipeline pipeline = VK_NULL_HANDLE;
  VkDescriptorPool descriptors = VK_NULL_HANDLE;
  VkDescriptorSet set = VK_NULL_HANDLE;
  VkCommandPool commands = VK_NULL_HANDLE;
  std::string error;

  // Records the first failure; returns whether the call succeeded.
  bool ok(VkResult result, const char* call) {
    if (result != VK_SUCCESS && error.empty())
      error = fmt::format("{} failed with VkResult {}", call, static_cast<int>(result));
    return result == VK_SUCCESS;
  }

  bool open();
  bool make_buffer(Buffer* out, VkDeviceSize size);
  bool make_pipeline(std::span<const std::uint32_t> spirv);
  bool bind_buffers();
  bool submit(std::uint32_t groups);

  ~Run() {
    if (!device) return;
    vkDestroyCommandPool(device, commands, nullptr);
    vkDestroyDescriptorPool(device, descriptors, nullptr);
    vkDestroyPipeline(device, pipeline, nullptr);
    vkDestroyShaderModule(device, shader, nullptr);
    vkDestroyPipelineLayout(device, layout, nullptr);
    vkDestroyDescriptorSetLayout(device, set_layout, nullptr);
    for (Buffer& b : buffers) {
      vkDestroyBuffer(device, b.buffer, nullptr);
      vkFreeMemory(device, b.memory, nullptr);
    }
    vkDestroyDevice(device, nullptr);
  }
};

bool Run::open() {
  const float priority = 1.0f;
  auto queue_info = structure<VkDeviceQueueCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO);
  queue_info.queueFamilyIndex = family;
  queue_info.queueCount = 1;
  queue_info.pQueuePriorities = &priority;
  auto info = structure<VkDeviceCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO);
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue_info;
  if (!ok(vkCreateDevice(physical, &info, nullptr, &device), "vkCreateDevice")) return false;
  volkLoadDevice(device);
  vkGetDeviceQueue(device, family, 0, &queue);
  return true;
}

bool Run::make_buffer(Buffer* out, VkDeviceSize size) {
  auto info = structure<VkBufferCreateInfo>(VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO);
  info.size = size;
  info.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
  if (!ok(vkCreateBuffer(device, &info, nullptr, &out->buffer), "vkCreateBuffer")) return false;
  VkMemoryRequirements needs{};
  vkGetBufferMemoryRequirements(device, out->buffer, &needs);
  VkPhysicalDeviceMemoryProperties memory{};
  vkGetPhysicalDeviceMemoryProperties(physical, &memory);
  const VkMemoryPropertyFlags required =
      VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
  auto allocate = structure<VkMemoryAllocateInfo>(VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO);
  allocate.allocationSize = needs.size;
  // The specification guarantees a host-visible, coherent type for every buffer.
  for (std::uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
    if ((needs.memoryTypeBits >> i & 1u) &&
        (memory.memoryTypes[i].propertyFlags & required) == required) {
      allocate.memoryTypeIndex = i;
      break;
    }
  }
  return ok(vkAllocateMemory(device, &allocate, nullptr, &out->memory), "vkAllocateMemory") &&
         ok(vkBindBufferMemory(device, out->buffer, out->memory, 0), "vkBindBufferMemory") &&
         ok(vkMapMemory(device, out->memory, 0, VK_WHOLE_SIZE, 0, &out->mapped), "vkMapMemory");
}

bool Run::make_pipeline(std::span<const std::uint32_t> spirv) {
  VkDescriptorSetLayoutBinding bindings[2]{};
  for (std::uint32_t i = 0; i < 2; ++i)
    bindings[i] = {i, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr};
  auto set_info = structure<VkDescriptorSetLayoutCreateInfo>(
      VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO);
  set_info.bindingCount = 2;
  set_info.pBindings = bindings;
  if (!ok(vkCreateDescriptorSetLayout(device, &set_info, nullptr, &set_layout),
          "vkCreateDescriptorSetLayout"))
    return false;
  auto layout_info =
      structure<VkPipelineLayoutCreateInfo>(VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO);
  layout_info.setLayoutCount = 1;
  layout_info.pSetLayouts = &set_layout;
  if (!ok(vkCreatePipelineLayout(device, &layout_info, nullptr, &layout), "vkCreatePipelineLayout"))
    return false;
  auto shader_info =
      structure<VkShaderModuleCreateInfo>(VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO);
  shader_info.codeSize = spirv.size_bytes();
  shader_info.pCode = spirv.data();
  if (!ok(vkCreateShaderModule(device, &shader_info, nullptr, &shader), "vkCreateShaderModule"))
    return false;
  auto info =
      structure<VkComputePipelineCreateInfo>(VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO);
  info.stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
  info.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
  info.stage.module = shader;
  info.stage.pName = "main";
  info.layout = layout;
  return ok(vkCreateComputePipelines(device, VK_NULL_HANDLE, 1, &info, nullptr, &pipeline),
            "vkCreateComputePipelines");
}

bool Run::bind_buffers() {
  const VkDescriptorPoolSize size{VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 2};
  auto pool_info =
      structure<VkDescriptorPoolCreateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO);
  pool_info.maxSets = 1;
  pool_info.poolSizeCount = 1;
  pool_info.pPoolSizes = &size;
  if (!ok(vkCreateDescriptorPool(device, &pool_info, nullptr, &descriptors),
          "vkCreateDescriptorPool"))
    return false;
  auto set_info =
      structure<VkDescriptorSetAllocateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO);
  set_info.descriptorPool = descriptors;
  set_info.descriptorSetCount = 1;
  set_info.pSetLayouts = &set_layout;
  if (!ok(vkAllocateDescriptorSets(device, &set_info, &set), "vkAllocateDescriptorSets"))
    return false;
  VkDescriptorBufferInfo infos[2]{};
  VkWriteDescriptorSet writes[2]{};
  for (std::uint32_t i = 0; i < 2; ++i) {
    infos[i] = {buffers[i].buffer, 0, VK_WHOLE_SIZE};
    writes[i].sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
    writes[i].dstSet = set;
    writes[i].dstBinding = i;
    writes[i].descriptorCount = 1;
    writes[i].descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    writes[i].pBufferInfo = &infos[i];
  }
  vkUpdateDescriptorSets(device, 2, writes, 0, nullptr);
  return true;
}

bool Run::submit(std::uint32_t groups) {
  auto pool_info = structure<VkCommandPoolCreateInfo>(VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO);
  pool_info.queueFamilyIndex = family;
  if (!ok(vkCreateCommandPool(device, &pool_info, nullptr, &commands), "vkCreateCommandPool"))
    return false;
  auto allocate =
      structure<VkCommandBufferAllocateInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO);
  allocate.commandPool = commands;
  allocate.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
  allocate.commandBufferCount = 1;
  VkCommandBuffer buffer = VK_NULL_HANDLE;
  if (!ok(vkAllocateCommandBuffers(device, &allocate, &buffer), "vkAllocateCommandBuffers"))
    return false;
  auto begin = structure<VkCommandBufferBeginInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO);
  begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  if (!ok(vkBeginCommandBuffer(buffer, &begin), "vkBeginCommandBuffer")) return false;
  vkCmdBindPipeline(buffer, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
  vkCmdBindDescriptorSets(buffer, VK_PIPELINE_BIND_POINT_COMPUTE, layout, 0, 1, &set, 0, nullptr);
  vkCmdDispatch(buffer, groups, 1, 1);
  auto barrier = structure<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
  vkCmdPipelineBarrier(buffer, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0,
                       1, &barrier, 0, nullptr, 0, nullptr);
  if (!ok(vkEndCommandBuffer(buffer), "vkEndCommandBuffer")) return false;
  auto submit_info = structure<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO);
  submit_info.commandBufferCount = 1;
  submit_info.pCommandBuffers = &buffer;
  return ok(vkQueueSubmit(queue, 1, &submit_info, VK_NULL_HANDLE), "vkQueueSubmit") &&
         ok(vkQueueWaitIdle(queue), "vkQueueWaitIdle");
}

}  // namespace

struct VulkanCompute::State {
  std::string missing;
  player::VulkanInstance instance;
  std::function<void(const std::string&)> on_message;
  std::vector<std::string> messages;
  std::vector<std::string> names;
  std::vector<VkPhysicalDevice> devices;
  std::vector<std::uint32_t> families;

  bool make_instance();
  void list_devices();
};

bool VulkanCompute::State::make_instance() {
  if (volkInitialize() != VK_SUCCESS) {
    missing = "no Vulkan loader (libvulkan.so.1)";
    return false;
  }
  on_message = [this](const std::string& message) { messages.push_back(message); };
  player::VulkanInstanceSettings settings;
  settings.on_message = &on_message;
  const VkResult result = make_vulkan_instance(settings, instance);
  if (result != VK_SUCCESS) {
    missing = fmt::format("vkCreateInstance failed with VkResult {}", static_cast<int>(result));
    return false;
  }
  volkLoadInstance(instance.instance);
  return true;
}

void VulkanCompute::State::list_devices() {
  std::uint32_t count = 0;
  vkEnumeratePhysicalDevices(instance.instance, &count, nullptr);
  std::vector<VkPhysicalDevice> all(count);
  vkEnumeratePhysicalDevices(instance.instance, &count, all.data());
  for (VkPhysicalDevice device : all) {
    const int family = compute_family(device);
    if (family < 0) continue;
    VkPhysicalDeviceProperties properties{};
    vkGetPhysicalDeviceProperties(device, &properties);
    devices.push_back(device);
    families.push_back(static_cast<std::uint32_t>(family));
    names.push_back(properties.deviceName);
  }
  if (devices.empty()) missing = "no Vulkan device with a compute queue";
}

VulkanCompute::VulkanCompute() : state_(std::make_unique<State>()) {
  if (state_->make_instance()) state_->list_devices();
}

VulkanCompute::~VulkanCompute() {
  const player::VulkanInstance& instance = state_->instance;
  if (!instance.instance) return;
  if (instance.messenger)
    vkDestroyDebugUtilsMessengerEXT(instance.instance, instance.messenger, nullptr);
  vkDestroyInstance(instance.instance, nullptr);
}

const std::string& VulkanCompute::missing() const {
  return state_->missing;
}
const std::vector<std::string>& VulkanCompute::devices() const {
  return state_->names;
}
std::uint32_t VulkanCompute::subgroup_size(std::size_t index) const {
  VkPhysicalDeviceSubgroupProperties subgroups{};
  subgroups.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES;
  VkPhysicalDeviceProperties2 properties{};
  properties.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
  properties.pNext = &subgroups;
  vkGetPhysicalDeviceProperties2(state_->devices[index], &properties);
  return subgroups.subgroupSize;
}
bool VulkanCompute::validated() const {
  return state_->instance.messenger != VK_NULL_HANDLE;
}
const std::vector<std::string>& VulkanCompute::messages() const {
  return state_->messages;
}

std::string VulkanCompute::run(std::size_t index, std::span<const std::uint32_t> spirv,
                               std::span<const std::byte> input, std::span<std::byte> output,
                               std::uint32_t groups) {
  Run run;
  run.physical = state_->devices[index];
  run.family = state_->families[index];
  if (!run.open() || !run.make_buffer(&run.buffers[0], input.size()) ||
      !run.make_buffer(&run.buffers[1], output.size()))
    return run.error;
  std::memcpy(run.buffers[0].mapped, input.data(), input.size());
  if (!run.make_pipeline(spirv) || !run.bind_buffers() || !run.submit(groups)) return run.error;
  std::memcpy(output.data(), run.buffers[1].mapped, output.size());
  return "";
}

}  // namespace stgs::test
