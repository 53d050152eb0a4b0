// SPDX-License-Identifier: Apache-2.0
#include "vulkan_compute.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <deque>

#include "vulkan_host/host_device.h"

namespace stgs::test {
namespace {

using tools::structure;
using tools::vk_status;

// The objects of one run; the device must outlive it.
class Run {
 public:
  explicit Run(const tools::DeviceHandles& device) : device_(device) {}
  Run(const Run&) = delete;
  Run& operator=(const Run&) = delete;
  ~Run() {
    vkDestroyPipeline(device_.device, pipeline_, nullptr);
    vkDestroyShaderModule(device_.device, shader_, nullptr);
    vkDestroyPipelineLayout(device_.device, layout_, nullptr);
  }

  Status make_pipeline(std::span<const std::uint32_t> spirv, std::size_t bindings);
  // Creates and fills the buffer of the next binding.
  Status make_buffer(const ComputeBuffer& contents);
  const std::uint8_t* data(std::size_t binding) const { return buffers_[binding].data(); }
  Status submit(std::uint32_t groups);

 private:
  const tools::DeviceHandles& device_;
  std::vector<VkDescriptorSetLayoutBinding> bindings_;
  std::deque<tools::MappedBuffer> buffers_;
  tools::DescriptorSet set_;
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  VkShaderModule shader_ = VK_NULL_HANDLE;
  VkPipeline pipeline_ = VK_NULL_HANDLE;
};

Status Run::make_pipeline(std::span<const std::uint32_t> spirv, std::size_t bindings) {
  for (std::uint32_t i = 0; i < bindings; ++i) {
    bindings_.push_back(
        {i, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr});
  }
  STGS_TRY(set_.create(device_.device, bindings_));
  STGS_TRY(tools::make_pipeline_layout(device_.device, set_, {}, &layout_));
  STGS_ASSIGN(shader_, tools::make_shader(device_.device, spirv));
  auto info =
      structure<VkComputePipelineCreateInfo>(VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO);
  info.stage = tools::stage_of(VK_SHADER_STAGE_COMPUTE_BIT, shader_);
  info.layout = layout_;
  return vk_status(
      vkCreateComputePipelines(device_.device, VK_NULL_HANDLE, 1, &info, nullptr, &pipeline_),
      "creating a pipeline");
}

Status Run::make_buffer(const ComputeBuffer& contents) {
  const std::size_t bytes =
      std::max({sizeof(std::uint32_t), contents.input.size(), contents.output.size()});
  tools::MappedBuffer& buffer = buffers_.emplace_back();
  STGS_TRY(buffer.ensure(device_, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, bytes));
  std::memset(buffer.data(), 0, bytes);
  if (!contents.input.empty())
    std::memcpy(buffer.data(), contents.input.data(), contents.input.size());
  const VkDescriptorBufferInfo range{buffer.handle(), 0, bytes};
  set_.write(bindings_[buffers_.size() - 1], nullptr, &range);
  return {};
}

Status Run::submit(std::uint32_t groups) {
  return tools::run_commands(device_, [&](VkCommandBuffer commands) {
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline_);
    vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, layout_, 0, 1, &set_.handle(),
                            0, nullptr);
    vkCmdDispatch(commands, groups, 1, 1);
    auto barrier = structure<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
    barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT;
    barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT,
                         0, 1, &barrier, 0, nullptr, 0, nullptr);
  });
}

Status run_on(const tools::DeviceHandles& device, std::span<const std::uint32_t> spirv,
              std::span<const ComputeBuffer> buffers, std::uint32_t groups) {
  Run run(device);
  STGS_TRY(run.make_pipeline(spirv, buffers.size()));
  for (const ComputeBuffer& buffer : buffers) STGS_TRY(run.make_buffer(buffer));
  STGS_TRY(run.submit(groups));
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    if (!buffers[i].output.empty())
      std::memcpy(buffers[i].output.data(), run.data(i), buffers[i].output.size());
  }
  return {};
}

}  // namespace

struct VulkanCompute::State {
  std::string missing;
  std::vector<std::string> messages;
  std::function<void(const std::string&)> add = [this](const std::string& message) {
    messages.push_back(message);
  };
  tools::HostDevice host;  // after `add`, which receives its last messages
  std::vector<std::string> names;
  std::vector<tools::HostDevice::Request> devices;

  bool make_instance();
  void list_devices();
};

bool VulkanCompute::State::make_instance() {
  if (volkInitialize() != VK_SUCCESS) {
    missing = "no Vulkan loader (libvulkan.so.1)";
    return false;
  }
  tools::InstanceSettings settings;
  settings.on_message = &add;
  const VkResult result = host.make_instance(settings);
  if (result != VK_SUCCESS) {
    missing = fmt::format("vkCreateInstance failed with VkResult {}", static_cast<int>(result));
  }
  return result == VK_SUCCESS;
}

void VulkanCompute::State::list_devices() {
  const auto all = tools::physical_devices(host.device().instance);
  if (all.ok()) {
    for (const VkPhysicalDevice device : *all) {
      const int family = tools::find_queue_family(device, VK_QUEUE_COMPUTE_BIT);
      if (family < 0) continue;
      VkPhysicalDeviceProperties properties{};
      vkGetPhysicalDeviceProperties(device, &properties);
      devices.push_back({device, static_cast<std::uint32_t>(family), {}, false, false});
      names.push_back(properties.deviceName);
    }
  }
  if (devices.empty()) missing = "no Vulkan device with a compute queue";
}

VulkanCompute::VulkanCompute() : state_(std::make_unique<State>()) {
  if (state_->make_instance()) state_->list_devices();
}

VulkanCompute::~VulkanCompute() = default;

const std::string& VulkanCompute::missing() const {
  return state_->missing;
}
const std::vector<std::string>& VulkanCompute::devices() const {
  return state_->names;
}
std::uint32_t VulkanCompute::subgroup_size(std::size_t index) const {
  auto subgroups = structure<VkPhysicalDeviceSubgroupProperties>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES);
  auto properties =
      structure<VkPhysicalDeviceProperties2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2);
  properties.pNext = &subgroups;
  vkGetPhysicalDeviceProperties2(state_->devices[index].physical_device, &properties);
  return subgroups.subgroupSize;
}
bool VulkanCompute::validated() const {
  return state_->host.is_validated();
}
const std::vector<std::string>& VulkanCompute::messages() const {
  return state_->messages;
}

std::string VulkanCompute::run(std::size_t index, std::span<const std::uint32_t> spirv,
                               std::span<const ComputeBuffer> buffers, std::uint32_t groups) {
  Status status = state_->host.open(state_->devices[index]);
  if (status.ok()) status = run_on(state_->host.device(), spirv, buffers, groups);
  state_->host.close();
  return status.message();
}

}  // namespace stgs::test
