// SPDX-License-Identifier: Apache-2.0
#include "vulkan/bandwidth.h"

#include <algorithm>
#include <array>

#include "vulkan/buffer.h"
#include "vulkan/pipelines.h"
#include "vulkan/timestamps.h"

namespace stgs::player::vulkan {
namespace {

constexpr std::uint32_t kCopyCode[] = {
#include "copy.spv.inc"
};
// Bytes per workgroup (copy.comp), and in total. Every device supports ranges and dispatches of the
// maximum; smaller ones are used if its memory is nearly full.
constexpr std::uint64_t kGroupBytes = 256 * 4 * 16;
constexpr std::uint64_t kMaxCopied = std::uint64_t{128} << 20, kMinCopied = kMaxCopied / 8;
constexpr std::uint32_t kCopies = 6;
static_assert(kMaxCopied / kGroupBytes <= 65535 && kCopies + 1 <= Timestamps::kMaxCount);

// The copy shader with its two buffers.
class Copy {
 public:
  explicit Copy(const Device& device) : device_(device) {}
  Copy(const Copy&) = delete;
  Copy& operator=(const Copy&) = delete;
  ~Copy() {
    const auto& vk = device_.vk;
    vk.vkDestroyPipeline(device_.handle(), pipeline_, nullptr);
    vk.vkDestroyDescriptorPool(device_.handle(), pool_, nullptr);
    vk.vkDestroyPipelineLayout(device_.handle(), layout_, nullptr);
    vk.vkDestroyDescriptorSetLayout(device_.handle(), buffers_, nullptr);
  }

  Status create() {
    Status status = create_buffers(kMaxCopied);
    for (std::uint64_t bytes = kMaxCopied / 2;
         status.code() == StatusCode::kNoMemory && bytes >= kMinCopied; bytes /= 2) {
      status = create_buffers(bytes);
    }
    STGS_TRY(status);
    STGS_TRY(make_layout());
    STGS_TRY(make_set());
    const auto stage = structure<VkPipelineShaderStageCreateInfo>(
        VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO);
    return make_pipeline(device_, kCopyCode, stage, layout_, &pipeline_);
  }

  void record(VkCommandBuffer commands) const {
    const auto& vk = device_.vk;
    vk.vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline_);
    vk.vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, layout_, 0, 1, &set_, 0,
                               nullptr);
    vk.vkCmdDispatch(commands, static_cast<std::uint32_t>(bytes() / kGroupBytes), 1, 1);
  }
  std::uint64_t bytes() const { return memory_[0].bytes(); }

 private:
  Status create_buffers(std::uint64_t bytes) {
    for (Buffer& one : memory_) one.reset();
    for (Buffer& one : memory_) STGS_TRY(one.create(device_, bytes, MemoryLocation::kDevice));
    return {};
  }

  Status make_layout() {
    STGS_TRY(make_buffers_layout(device_, 2, &buffers_));
    auto info =
        structure<VkPipelineLayoutCreateInfo>(VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO);
    info.setLayoutCount = 1;
    info.pSetLayouts = &buffers_;
    return vk_status(device_.vk.vkCreatePipelineLayout(device_.handle(), &info, nullptr, &layout_),
                     "creating a pipeline layout");
  }

  Status make_set() {
    const VkDescriptorPoolSize size{VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 2};
    auto pool =
        structure<VkDescriptorPoolCreateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO);
    pool.maxSets = pool.poolSizeCount = 1;
    pool.pPoolSizes = &size;
    STGS_TRY(vk_status(device_.vk.vkCreateDescriptorPool(device_.handle(), &pool, nullptr, &pool_),
                       "creating a descriptor pool"));
    auto info =
        structure<VkDescriptorSetAllocateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO);
    info.descriptorPool = pool_;
    info.descriptorSetCount = 1;
    info.pSetLayouts = &buffers_;
    STGS_TRY(vk_status(device_.vk.vkAllocateDescriptorSets(device_.handle(), &info, &set_),
                       "allocating a descriptor set"));
    const VkDescriptorBufferInfo buffers[] = {{memory_[0].handle(), 0, VK_WHOLE_SIZE},
                                              {memory_[1].handle(), 0, VK_WHOLE_SIZE}};
    auto write = structure<VkWriteDescriptorSet>(VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET);
    write.dstSet = set_;
    write.descriptorCount = 2;
    write.descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    write.pBufferInfo = buffers;
    device_.vk.vkUpdateDescriptorSets(device_.handle(), 1, &write, 0, nullptr);
    return {};
  }

  const Device& device_;
  std::array<Buffer, 2> memory_;
  VkDescriptorSetLayout buffers_ = VK_NULL_HANDLE;
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  VkDescriptorPool pool_ = VK_NULL_HANDLE;
  VkDescriptorSet set_ = VK_NULL_HANDLE;
  VkPipeline pipeline_ = VK_NULL_HANDLE;
};

}  // namespace

Result<double> measure_bandwidth(Device& device) {
  Copy copy(device);
  STGS_TRY(copy.create());
  Timestamps timestamps;
  STGS_TRY(timestamps.create(device, kCopies + 1));
  VkCommandBuffer commands = VK_NULL_HANDLE;
  STGS_TRY(device.begin(&commands));
  device.vk.vkCmdResetQueryPool(commands, timestamps.pool(), 0, kCopies + 1);
  for (std::uint32_t k = 0; k <= kCopies; ++k) {
    barrier(device, commands);
    device.vk.vkCmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, timestamps.pool(),
                                  k);
    if (k < kCopies) copy.record(commands);
  }
  STGS_TRY(device.finish(commands));
  std::array<double, kCopies> ms{};
  STGS_TRY(timestamps.between(ms));
  // The fastest copy, since the first one touches the memory for the first time.
  const double min_ms = *std::min_element(ms.begin(), ms.end());
  return 2e3 * static_cast<double>(copy.bytes()) / std::max(min_ms, 1e-6);
}

}  // namespace stgs::player::vulkan
