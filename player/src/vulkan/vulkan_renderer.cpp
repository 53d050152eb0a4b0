// SPDX-License-Identifier: Apache-2.0
#include "vulkan/vulkan_renderer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <exception>
#include <vector>

#include "views.h"
#include "vulkan/frame_commands.h"
#include "vulkan/packed_segment.h"
#include "vulkan/segment_cache.h"

namespace stgs::player {
namespace {

using namespace vulkan;
using Clock = std::chrono::steady_clock;

// Of splats in tiles, for each splat that there can be; a first guess.
constexpr std::uint64_t kInstancesEach = 4;
constexpr std::uint64_t kLeastInstances = std::uint64_t{1} << 18;
constexpr std::uint64_t kPlaneAlign = 256;  // that every device is content with

int tiles_along(int pixels) {
  return (pixels + kTilePixels - 1) / kTilePixels;
}

// One of the views of a call: its picture, and what was counted.
struct Slot {
  int width = 0, height = 0;
  Buffer picture;
  std::uint64_t pixels() const {
    return static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  }
  std::uint64_t plane_bytes() const {
    return (sizeof(float) * pixels() + kPlaneAlign - 1) / kPlaneAlign * kPlaneAlign;
  }
  std::uint64_t picture_bytes() const { return kPlanes * plane_bytes(); }
};

class VulkanRenderer final : public Renderer {
 public:
  explicit VulkanRenderer(const VulkanSettings& settings) : settings_(settings) {}
  ~VulkanRenderer() override {
    if (times_ != VK_NULL_HANDLE) {
      device_.vk.vkDestroyQueryPool(device_.handle(), times_, nullptr);
    }
  }

  Status create() {
    STGS_TRY(device_.create(settings_));
    segments_.create(device_, settings_.block_bytes);
    STGS_TRY(told_.create(device_, sizeof(Counts), Place::kHost));
    if (device_.timestamp_ns() == 0) return {};
    auto info = structure<VkQueryPoolCreateInfo>(VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO);
    info.queryType = VK_QUERY_TYPE_TIMESTAMP;
    info.queryCount = kTimes;
    return vk_status(device_.vk.vkCreateQueryPool(device_.handle(), &info, nullptr, &times_),
                     "making room for times");
  }

  std::string name() const override { return "vulkan"; }

  Status draw(Timeline& timeline, double seconds, const std::vector<View>& views,
              RenderStats* stats) override {
    STGS_TRY(check_views(views));
    drawn_views_ = 0;
    try {
      RenderStats sums;
      const auto begin = Clock::now();
      STGS_ASSIGN(const auto alive, segments_.hold(timeline, seconds));
      list_parts(alive);
      sums.fetch_ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
      sums.stored = segments_.stored_primitives();
      const int degree = timeline.reader().sh_degree();
      STGS_TRY(pipelines_.create(device_, degree));
      for (std::size_t i = 0; i < views.size(); ++i) {
        STGS_TRY(draw_view(timeline, seconds, degree, views[i], slots_[i]));
        sums.alive = counted().alive;
        sums.drawn += counted().visible;
        STGS_TRY(add_times(sums));
      }
      if (stats != nullptr) *stats = sums;
    } catch (const std::exception& e) {
      return runtime_error("{}: cannot draw {} s: {}", timeline.name(), seconds, e.what());
    }
    drawn_views_ = views.size();
    return {};
  }

  Status read(std::vector<Frame>& frames) override {
    try {
      frames.resize(drawn_views_);
      for (std::size_t i = 0; i < drawn_views_; ++i) STGS_TRY(read_slot(slots_[i], frames[i]));
    } catch (const std::exception& e) {
      return runtime_error("no memory for a picture: {}", e.what());
    }
    return {};
  }

 private:
  Counts counted() const {
    Counts counts{};
    std::memcpy(&counts, told_.mapped(), sizeof(counts));
    return counts;
  }

  // The pieces that are drawn, numbered in the order of ids, then put together by block.
  void list_parts(const std::vector<Timeline::Needed>& needed) {
    std::vector<std::vector<Part>> of_block(segments_.memory().blocks());
    chunks_ = 0;
    for (const Timeline::Needed& one : needed) {
      for (const Piece& piece : segments_.at(one.segment)) {
        Part part{};
        part.at = static_cast<std::uint32_t>(piece.room.offset / SegmentMemory::kAlign);
        part.primitives = piece.primitives;
        part.first_chunk = chunks_;
        part.ticks = static_cast<float>(one.ticks);
        part.ticks_rest = static_cast<float>(one.ticks - static_cast<double>(part.ticks));
        of_block[piece.room.block].push_back(part);
        chunks_ += padded(piece.primitives) / kGroup;
      }
    }
    parts_.clear();
    blocks_.clear();
    for (std::uint32_t b = 0; b < of_block.size(); ++b) {
      if (of_block[b].empty()) continue;
      BlockParts block{b, static_cast<std::uint32_t>(parts_.size()),
                       static_cast<std::uint32_t>(of_block[b].size()), 0};
      for (Part& part : of_block[b]) {
        part.first_group = block.groups;
        block.groups += padded(part.primitives) / kGroup;
        parts_.push_back(part);
      }
      blocks_.push_back(block);
    }
  }

  ViewInput input_of(const View& view, const Slot& slot) const {
    ViewInput input{};
    input.camera = view.camera;
    input.centre = math::camera_centre(view.camera);
    input.background = view.background;
    input.width = slot.width;
    input.height = slot.height;
    input.tiles_x = tiles_along(slot.width);
    input.tiles_y = tiles_along(slot.height);
    input.chunks = chunks_;
    input.instance_capacity = static_cast<std::uint32_t>(
        std::min(buffers_.instance_capacity(), FrameBuffers::most_instances(device_)));
    return input;
  }

  // Draws, and again with more room where the instances did not fit.
  Status draw_view(const Timeline& timeline, double seconds, int degree, const View& view,
                   Slot& slot) {
    slot.width = static_cast<int>(std::lround(view.camera.width));
    slot.height = static_cast<int>(std::lround(view.camera.height));
    if (slot.plane_bytes() > device_.most_range()) {
      return unsupported(
          "a picture of {}x{} pixels is larger than the Vulkan device's storage buffers ({} MiB); "
          "use --backend cpu",
          slot.width, slot.height, device_.most_range() >> 20);
    }
    STGS_TRY(slot.picture.ensure(device_, slot.picture_bytes(), Place::kDevice));
    const std::uint64_t most = FrameBuffers::most_instances(device_);
    FrameNeed need;
    need.chunks = chunks_;
    need.parts = static_cast<std::uint32_t>(parts_.size());
    need.tiles = static_cast<std::uint32_t>(tiles_along(slot.width) * tiles_along(slot.height));
    if (buffers_.instance_capacity() == 0) {
      need.instances = settings_.instances > 0
                           ? settings_.instances
                           : std::max(kLeastInstances, kInstancesEach * kGroup * chunks_);
      need.instances = std::min(need.instances, most);
    }
    for (;;) {
      STGS_TRY(buffers_.ensure(device_, need));
      const ViewInput input = input_of(view, slot);
      const FrameWork work{
          &input,         parts_, blocks_, degree, slot.picture.handle(), slot.plane_bytes(),
          told_.handle(), times_};
      VkCommandBuffer commands = VK_NULL_HANDLE;
      STGS_TRY(device_.begin(&commands));
      STGS_TRY(commands_.record(device_, pipelines_, segments_.memory(), buffers_, work, commands));
      STGS_TRY(device_.finish(commands));
      need.instances = counted().instances;
      if (need.instances <= input.instance_capacity) return {};
      if (need.instances > most) {
        return runtime_error(
            "{}: cannot draw {} s: the view's splats touch more tiles than a frame can list "
            "(2^{})",
            timeline.name(), seconds, std::bit_width(most) - 1);
      }
    }
  }

  Status add_times(RenderStats& stats) {
    if (times_ == VK_NULL_HANDLE) return {};
    std::uint64_t at[kTimes] = {};
    STGS_TRY(
        vk_status(device_.vk.vkGetQueryPoolResults(device_.handle(), times_, 0, kTimes, sizeof(at),
                                                   at, sizeof(at[0]), VK_QUERY_RESULT_64_BIT),
                  "reading the times of the stages"));
    double* const sums[] = {&stats.slice_ms, &stats.bin_ms, &stats.blend_ms};
    for (std::size_t stage = 0; stage + 1 < kTimes; ++stage) {
      const std::uint64_t steps = (at[stage + 1] - at[stage]) & device_.timestamp_mask();
      const double ms = 1e-6 * device_.timestamp_ns() * static_cast<double>(steps);
      *sums[stage] += ms;
      stats.device_ms += ms;
    }
    return {};
  }

  Status read_slot(const Slot& slot, Frame& frame) {
    STGS_TRY(read_back_.ensure(device_, slot.picture_bytes(), Place::kHost));
    VkCommandBuffer commands = VK_NULL_HANDLE;
    STGS_TRY(device_.begin(&commands));
    const VkBufferCopy region{0, 0, slot.picture_bytes()};
    device_.vk.vkCmdCopyBuffer(commands, slot.picture.handle(), read_back_.handle(), 1, &region);
    barrier(device_, commands);
    STGS_TRY(device_.finish(commands));
    frame.colour.reshape(slot.width, slot.height, 3);
    frame.alpha.reshape(slot.width, slot.height, 1);
    frame.depth.reshape(slot.width, slot.height, 1);
    const std::uint8_t* from = read_back_.mapped();
    for (Image* image : {&frame.colour, &frame.alpha, &frame.depth}) {
      for (std::size_t at = 0; at < image->data.size(); at += slot.pixels()) {
        std::memcpy(image->data.data() + at, from, sizeof(float) * slot.pixels());
        from += slot.plane_bytes();
      }
    }
    return {};
  }

  VulkanSettings settings_;
  Device device_;  // outlives all that follows
  Pipelines pipelines_;
  SegmentCache segments_;
  FrameBuffers buffers_;
  FrameCommands commands_;
  Buffer told_, read_back_;
  VkQueryPool times_ = VK_NULL_HANDLE;
  std::array<Slot, kMaxViews> slots_;
  std::vector<Part> parts_;  // of the moment
  std::vector<BlockParts> blocks_;
  std::uint32_t chunks_ = 0;
  std::size_t drawn_views_ = 0;
};

}  // namespace

Result<std::unique_ptr<Renderer>> make_vulkan_renderer(const VulkanSettings& settings) {
  auto renderer = std::make_unique<VulkanRenderer>(settings);
  STGS_TRY(renderer->create());
  return std::unique_ptr<Renderer>(std::move(renderer));
}

}  // namespace stgs::player
