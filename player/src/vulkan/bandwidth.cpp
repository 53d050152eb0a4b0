// SPDX-License-Identifier: Apache-2.0
#include "vulkan/bandwidth.h"

#include <algorithm>
#include <array>

#include "vulkan/buffer.h"
#include "vulkan/pipelines.h"
#include "vulkan/times.h"

namespace stgs::player::vulkan {
namespace {

constexpr std::uint32_t kCopyCode[] = {
#include "copy.spv.inc"
};
// Of a workgroup (copy.comp), and of all: every device has ranges and dispatches for the most, and
// where its memory is nearly full, less will do.
constexpr std::uint64_t kGroupBytes = 256 * 4 * 16;
constexpr std::uint64_t kMostCopied = std::uint64_t{128} << 20, kLeastCopied = kMostCopied / 8;
constexpr std::uint32_t kCopies = 6;
static_assert(kMostCopied / kGroupBytes <= 65535 && kCopies + 1 <= Times::kMost);

// The shader with its two buffers.
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
    Status status = make_room(kMostCopied);
    for (std::uint64_t bytes = kMostCopied / 2;
         status.code() == StatusCode::kNoMemory && bytes >= kLeastCopied; bytes /= 2) {
      status = make_room(bytes);
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
  Status make_room(std::uint64_t bytes) {
    for (Buffer& one : memory_) one.reset();
    for (Buffer& one : memory_) STGS_TRY(one.create(device_, bytes, Place::kDevice));
    return {};
  }

  Status make_layout() {
    STGS_TRY(make_buffers_layout(device_, 2, &buffers_));
    auto info =
        structure<VkPipelineLayoutCreateInfo>(VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO);
    info.setLayoutCount = 1;
    info.pSetLayouts = &buffers_;
    return vk_status(device_.vk.vkCreatePipelineLayout(device_.handle(), &info, nullptr, &layout_),
                     "creating a layout of shaders");
  }

  Status make_set() {
    const VkDescriptorPoolSize size{VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 2};
    auto pool =
        structure<VkDescriptorPoolCreateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO);
    pool.maxSets = pool.poolSizeCount = 1;
    pool.pPoolSizes = &size;
    STGS_TRY(vk_status(device_.vk.vkCreateDescriptorPool(device_.handle(), &pool, nullptr, &pool_),
                       "making room for buffer sets"));
    auto info =
        structure<VkDescriptorSetAllocateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO);
    info.descriptorPool = pool_;
    info.descriptorSetCount = 1;
    info.pSetLayouts = &buffers_;
    STGS_TRY(vk_status(device_.vk.vkAllocateDescriptorSets(device_.handle(), &info, &set_),
                       "making a buffer set"));
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

Result<double> copied_bytes_per_second(Device& device) {
  Copy copy(device);
  STGS_TRY(copy.create());
  Times times;
  STGS_TRY(times.create(device, kCopies + 1));
  VkCommandBuffer commands = VK_NULL_HANDLE;
  STGS_TRY(device.begin(&commands));
  device.vk.vkCmdResetQueryPool(commands, times.pool(), 0, kCopies + 1);
  for (std::uint32_t k = 0; k <= kCopies; ++k) {
    barrier(device, commands);
    device.vk.vkCmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, times.pool(), k);
    if (k < kCopies) copy.record(commands);
  }
  STGS_TRY(device.finish(commands));
  std::array<double, kCopies> ms{};
  STGS_TRY(times.between(ms));
  // The fastest: the first touches the memory for the first time.
  const double least = *std::min_element(ms.begin(), ms.end());
  return 2e3 * static_cast<double>(copy.bytes()) / std::max(least, 1e-6);
}

}  // namespace stgs::player::vulkan
