// SPDX-License-Identifier: Apache-2.0
#include "vulkan/frame_commands.h"

#include <algorithm>
#include <array>

namespace stgs::player::vulkan {
namespace {

constexpr std::uint32_t kStageSets = 32;  // per frame, in addition to those of blocks and views
constexpr std::uint64_t kUpdateBytes = 65536;  // maximum of vkCmdUpdateBuffer

std::uint32_t groups_for(std::uint32_t items, std::uint32_t each) {
  return (items + each - 1) / each;
}

std::uint32_t squares_along(int tiles) {
  return groups_for(static_cast<std::uint32_t>(tiles), 2);
}

}  // namespace

FrameCommands::~FrameCommands() {
  if (device_ != nullptr) device_->vk.vkDestroyDescriptorPool(device_->handle(), pool_, nullptr);
}

Status FrameCommands::reset_pool(const Device& device, std::uint32_t sets) {
  const auto& vk = device.vk;
  device_ = &device;
  if (sets <= sets_) {
    return vk_status(vk.vkResetDescriptorPool(device.handle(), pool_, 0),
                     "resetting a descriptor pool");
  }
  vk.vkDestroyDescriptorPool(device.handle(), pool_, nullptr);
  pool_ = VK_NULL_HANDLE;
  sets_ = 0;
  const VkDescriptorPoolSize size{
      VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
      static_cast<std::uint32_t>(kMaxViews) * kFrameBindings + sets * kStageBindings};
  auto info = structure<VkDescriptorPoolCreateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO);
  info.maxSets = static_cast<std::uint32_t>(kMaxViews) + sets;
  info.poolSizeCount = 1;
  info.pPoolSizes = &size;
  STGS_TRY(vk_status(vk.vkCreateDescriptorPool(device.handle(), &info, nullptr, &pool_),
                     "creating a descriptor pool"));
  sets_ = sets;
  return {};
}

class FrameCommands::Recorder {
 public:
  Recorder(const Device& device, const Pipelines& pipelines, const FrameBuffers& buffers,
           const FrameWork& work, VkDescriptorPool pool, VkCommandBuffer commands)
      : device_(device),
        pipelines_(pipelines),
        b_(buffers),
        work_(work),
        pool_(pool),
        commands_(commands) {}

  Status record(const SegmentMemory& memory) {
    if (work_.stage_timestamps != VK_NULL_HANDLE) {
      device_.vk.vkCmdResetQueryPool(commands_, work_.stage_timestamps, 0, kStageTimestamps);
    }
    if (work_.step_timestamps != VK_NULL_HANDLE) {
      device_.vk.vkCmdResetQueryPool(commands_, work_.step_timestamps, 0, kFrameSteps + 1);
    }
    end_stage(0);
    write_timestamp(work_.step_timestamps, 0);
    upload_input();
    end_step(kClear);
    STGS_TRY(allocate_frame_sets());
    bind(0, frame_sets_[0]);
    STGS_TRY(slice(memory));
    end_stage(1);
    STGS_TRY(bin());
    end_stage(2);
    STGS_TRY(blend());
    end_stage(3);
    end_step(kBlend);
    barrier(device_, commands_);
    const VkBufferCopy counts{0, 0, sizeof(Counts)};
    device_.vk.vkCmdCopyBuffer(commands_, b_.counts.handle(), work_.counts, 1, &counts);
    barrier(device_, commands_);
    return {};
  }

 private:
  using StageBuffers = std::array<VkBuffer, kStageBindings>;

  std::uint32_t tiles() const { return work_.input->tiles; }  // over all views
  std::uint32_t chunks() const { return work_.input->views * work_.input->chunks; }
  std::uint32_t passes() const { return tile_passes(tiles()); }
  DigitRows digit_rows() const {
    return {std::uint64_t{kGroup} * chunks(), work_.input->instance_capacity};
  }
  // Returns a buffer to bind for outputs that the blend does not write: the other list of the sort,
  // which is no longer needed.
  VkBuffer unused() const { return b_.tile_splats[1 - passes() % 2].handle(); }

  void write_timestamp(VkQueryPool to, std::uint32_t number) {
    if (to == VK_NULL_HANDLE) return;
    device_.vk.vkCmdWriteTimestamp(commands_, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, to, number);
  }
  void end_stage(std::uint32_t number) { write_timestamp(work_.stage_timestamps, number); }
  void end_step(FrameStep step) {
    write_timestamp(work_.step_timestamps, static_cast<std::uint32_t>(step) + 1);
  }

  void update(const Buffer& to, std::uint64_t offset, const void* data, std::uint64_t bytes) {
    for (std::uint64_t at = 0; at < bytes; at += kUpdateBytes) {
      device_.vk.vkCmdUpdateBuffer(commands_, to.handle(), offset + at,
                                   std::min(kUpdateBytes, bytes - at),
                                   static_cast<const std::uint8_t*>(data) + at);
    }
  }

  // Uploads the input and clears the counts.
  void upload_input() {
    update(b_.input, 0, work_.input, sizeof(FrameInput));
    update(b_.input, sizeof(FrameInput), work_.parts.data(), work_.parts.size_bytes());
    device_.vk.vkCmdFillBuffer(commands_, b_.counts.handle(), 0, kCountBytes, 0);
    device_.vk.vkCmdFillBuffer(commands_, b_.tile_ranges.handle(), 0, std::uint64_t{8} * tiles(),
                               0);
    const DigitRows rows = digit_rows();
    device_.vk.vkCmdFillBuffer(commands_, b_.digit_counts.handle(), rows.groups * DigitRows::kBytes,
                               (rows.end(passes()) - rows.groups) * DigitRows::kBytes, 0);
    barrier(device_, commands_);
  }

  // Allocates a descriptor set with the buffers.
  Result<VkDescriptorSet> allocate_set(VkDescriptorSetLayout layout,
                                       std::span<const VkDescriptorBufferInfo> buffers) {
    auto info =
        structure<VkDescriptorSetAllocateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO);
    info.descriptorPool = pool_;
    info.descriptorSetCount = 1;
    info.pSetLayouts = &layout;
    VkDescriptorSet set = VK_NULL_HANDLE;
    STGS_TRY(vk_status(device_.vk.vkAllocateDescriptorSets(device_.handle(), &info, &set),
                       "allocating a descriptor set"));
    auto write = structure<VkWriteDescriptorSet>(VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET);
    write.dstSet = set;
    // Descriptors beyond the first binding continue with the following bindings.
    write.descriptorCount = static_cast<std::uint32_t>(buffers.size());
    write.descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    write.pBufferInfo = buffers.data();
    device_.vk.vkUpdateDescriptorSets(device_.handle(), 1, &write, 0, nullptr);
    return set;
  }

  void bind(std::uint32_t number, VkDescriptorSet set) {
    device_.vk.vkCmdBindDescriptorSets(commands_, VK_PIPELINE_BIND_POINT_COMPUTE,
                                       pipelines_.layout(), number, 1, &set, 0, nullptr);
  }

  Result<VkDescriptorSet> frame_set(const ImageBuffers& image) {
    std::vector<VkDescriptorBufferInfo> infos;
    for (const Buffer* buffer :
         {&b_.input, &b_.counts, &b_.splats[0], &b_.splats[1], &b_.splats[2], &b_.chunk_offsets,
          &b_.chunk_sums, &b_.tile_offsets, &b_.tile_ranges, &b_.digit_counts}) {
      infos.push_back({buffer->handle(), 0, VK_WHOLE_SIZE});
    }
    for (const VkDescriptorBufferInfo& plane : image.planes) {
      infos.push_back(plane.buffer != VK_NULL_HANDLE
                          ? plane
                          : VkDescriptorBufferInfo{unused(), 0, VK_WHOLE_SIZE});
    }
    return allocate_set(pipelines_.frame_set(), infos);
  }

  Status allocate_frame_sets() {
    for (std::uint32_t v = 0; v < work_.input->views; ++v) {
      STGS_ASSIGN(frame_sets_[v], frame_set(work_.images[v]));
    }
    return {};
  }

  Result<VkDescriptorSet> stage_set(const StageBuffers& buffers) {
    std::array<VkDescriptorBufferInfo, kStageBindings> infos{};
    for (std::size_t i = 0; i < infos.size(); ++i) infos[i] = {buffers[i], 0, VK_WHOLE_SIZE};
    return allocate_set(pipelines_.stage_set(), infos);
  }

  Status stage(const StageBuffers& buffers) {
    STGS_ASSIGN(const VkDescriptorSet set, stage_set(buffers));
    bind(1, set);
    return {};
  }

  void use(Shader shader, const Push& push) {
    device_.vk.vkCmdBindPipeline(commands_, VK_PIPELINE_BIND_POINT_COMPUTE,
                                 pipelines_.of(shader, work_.sh_degree));
    device_.vk.vkCmdPushConstants(commands_, pipelines_.layout(), VK_SHADER_STAGE_COMPUTE_BIT, 0,
                                  sizeof(push), &push);
  }

  // Makes earlier shader writes visible to later shaders.
  void wait_for_shaders() { shader_barrier(device_, commands_); }

  void dispatch(Shader shader, const Push& push, std::uint32_t groups) {
    if (groups == 0) return;
    use(shader, push);
    device_.vk.vkCmdDispatch(commands_, std::min(groups, kGroupsX), groups_for(groups, kGroupsX),
                             1);
  }

  static std::uint64_t work_offset(std::uint32_t row) { return sizeof(Counts) + row * kWorkBytes; }

  // Dispatches the number of groups that the device has computed.
  void dispatch_indirect(Shader shader, const Push& push) {
    use(shader, push);
    device_.vk.vkCmdDispatchIndirect(commands_, b_.counts.handle(), work_offset(push.work));
  }
  void dispatch_indirect(Shader shader, std::uint32_t work) {
    Push push{};
    push.work = work;
    dispatch_indirect(shader, push);
  }

  // Blocks write disjoint chunks and need no barriers between them.
  Status slice(const SegmentMemory& memory) {
    for (const BlockParts& one : work_.blocks) {
      const VkBuffer block = memory.buffer(one.block);
      STGS_TRY(stage({block, block, block, block}));
      Push push{};
      push.first_part = one.first_part;
      push.part_count = one.parts;
      push.groups = one.groups;
      const bool several = work_.input->views > 1;
      dispatch(several ? Shader::kProjectSeveral : Shader::kProject, push, one.groups);
    }
    end_step(kProject);
    wait_for_shaders();
    dispatch(Shader::kScanChunks, {}, groups_for(chunks(), kScanTile));
    wait_for_shaders();
    STGS_TRY(stage({b_.depth_keys[0].handle(), b_.orders[0].handle(), b_.depth_keys[0].handle(),
                    b_.orders[0].handle()}));
    dispatch(Shader::kCompact, {}, groups_for(chunks(), kCompactChunks));
    end_step(kCompact);
    return {};
  }

  // Records a pass from the buffers [pass % 2] to the others.
  Status sort(std::uint32_t pass, const std::array<Buffer, 2>& keys,
              const std::array<Buffer, 2>& values, Push push) {
    const std::size_t from = pass % 2, to = 1 - from;
    const StageBuffers buffers = {keys[from].handle(), values[from].handle(), keys[to].handle(),
                                  values[to].handle()};
    STGS_TRY(stage(buffers));
    push.shift = 8 * pass;
    wait_for_shaders();
    dispatch_indirect(Shader::kSortCount, push);
    wait_for_shaders();
    dispatch_indirect(Shader::kSortScatter, push);
    return {};
  }

  Status bin() {
    const bool ballot = device_.uses_ballot();  // its sort also writes the tile ranges
    const DigitRows rows = digit_rows();
    for (std::uint32_t pass = 0; pass < kDepthPasses; ++pass) {
      Push push{};
      push.work = kWorkSortDepth;
      push.super_rows = rows.groups + pass * rows.depth;
      STGS_TRY(sort(pass, b_.depth_keys, b_.orders, push));
    }
    end_step(kDepthSort);
    STGS_TRY(stage({b_.depth_keys[0].handle(), b_.orders[0].handle(), b_.tile_keys[0].handle(),
                    b_.tile_splats[0].handle()}));
    wait_for_shaders();
    dispatch_indirect(work_.fovea ? Shader::kCountTilesFovea : Shader::kCountTiles,
                      kWorkCountTiles);
    wait_for_shaders();
    dispatch_indirect(work_.fovea ? Shader::kListTilesFovea : Shader::kListTiles, kWorkListTiles);
    end_step(kList);
    for (std::uint32_t pass = 0; pass < passes(); ++pass) {
      Push push{};
      push.work = kWorkSortTiles;
      push.super_rows = rows.end(pass);
      push.writes_ranges = ballot && pass + 1 == passes() ? 1u : 0u;
      STGS_TRY(sort(pass, b_.tile_keys, b_.tile_splats, push));
    }
    if (!ballot) {
      const VkBuffer keys = b_.tile_keys[passes() % 2].handle();
      STGS_TRY(stage({keys, keys, keys, keys}));
      wait_for_shaders();
      dispatch_indirect(Shader::kFindRanges, kWorkFindRanges);
    }
    end_step(kTileSort);
    return {};
  }

  // Computes the work items of the blend.
  Status find_patches() {
    const VkBuffer patches = b_.patches.handle();
    STGS_TRY(stage({patches, patches, patches, patches}));
    std::uint32_t max_squares = 0;
    for (std::uint32_t v = 0; v < work_.input->views; ++v) {
      const ViewInput& view = work_.input->view[v];
      max_squares =
          std::max(max_squares, squares_along(view.tiles_x) * squares_along(view.tiles_y));
    }
    wait_for_shaders();
    use(Shader::kFindPatches, {});
    device_.vk.vkCmdDispatch(commands_, groups_for(max_squares, kGroup), work_.input->views, 1);
    return {};
  }

  // Binds the buffers of view v and its image.
  void begin_blend(Shader shader, std::uint32_t v, std::uint32_t patches) {
    const ImageBuffers& image = work_.images[v];
    bind(0, frame_sets_[v]);
    bind(1, blend_sets_[v]);
    Push push{};
    push.pixels = image.pixels;
    push.with_depth = image.planes[kPlanes - 1].buffer != VK_NULL_HANDLE ? 1u : 0u;
    push.view = v;
    push.patches = patches;
    use(shader, push);
  }

  // Views write different images and need no barriers between them.
  Status blend() {
    const VkBuffer list = b_.tile_splats[passes() % 2].handle();
    for (std::uint32_t v = 0; v < work_.input->views; ++v) {
      const VkBuffer packed = work_.images[v].packed;
      STGS_ASSIGN(blend_sets_[v],
                  stage_set({list, list, packed != VK_NULL_HANDLE ? packed : unused(),
                             b_.patches.handle()}));
    }
    if (work_.fovea && device_.uses_ballot()) return blend_patches();
    wait_for_shaders();
    for (std::uint32_t v = 0; v < work_.input->views; ++v) {
      begin_blend(work_.fovea ? Shader::kBlendFovea : Shader::kBlend, v, 0);
      const ViewInput& view = work_.input->view[v];
      auto x = static_cast<std::uint32_t>(view.tiles_x);
      auto y = static_cast<std::uint32_t>(view.tiles_y);
      if (work_.fovea) {
        x = 2 * squares_along(view.tiles_x);
        y = 2 * squares_along(view.tiles_y);
      }
      device_.vk.vkCmdDispatch(commands_, x, y, 1);
    }
    return {};
  }

  // Patches with long lists come first, over all views: a late start would prolong the frame.
  Status blend_patches() {
    STGS_TRY(find_patches());
    wait_for_shaders();
    for (const std::uint32_t patches : {kLongPatches, kShortPatches}) {
      for (std::uint32_t v = 0; v < work_.input->views; ++v) {
        begin_blend(Shader::kBlendFovea, v, patches);
        device_.vk.vkCmdDispatchIndirect(commands_, b_.counts.handle(),
                                         work_offset(kWorkPatches + kPatchKinds * v + patches));
      }
    }
    return {};
  }

  const Device& device_;
  const Pipelines& pipelines_;
  const FrameBuffers& b_;
  const FrameWork& work_;
  VkDescriptorPool pool_;
  VkCommandBuffer commands_;
  std::array<VkDescriptorSet, kMaxViews> frame_sets_{}, blend_sets_{};  // per view
};

Status FrameCommands::record(const Device& device, const Pipelines& pipelines,
                             const SegmentMemory& memory, const FrameBuffers& buffers,
                             const FrameWork& work, VkCommandBuffer commands) {
  STGS_TRY(reset_pool(
      device, kStageSets + static_cast<std::uint32_t>(work.blocks.size() + work.images.size())));
  return Recorder(device, pipelines, buffers, work, pool_, commands).record(memory);
}

}  // namespace stgs::player::vulkan
