// SPDX-License-Identifier: Apache-2.0
#include "vulkan/vulkan_renderer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cstring>
#include <exception>
#include <utility>
#include <vector>

#include "views.h"
#include "vulkan/bandwidth.h"
#include "vulkan/caller_images.h"
#include "vulkan/frame_profile.h"
#include "vulkan/frame_slot.h"
#include "vulkan/frame_views.h"
#include "vulkan/packed_segment.h"
#include "vulkan/segment_cache.h"
#include "vulkan/times.h"

namespace stgs::player {
namespace {

using namespace vulkan;
using Clock = std::chrono::steady_clock;

// Of splats in tiles, for each splat that there can be; a first guess.
constexpr std::uint64_t kInstancesEach = 4;
constexpr std::uint64_t kLeastInstances = std::uint64_t{1} << 18;
// Frames that nobody waits for are to fit: room is made from so full a list on, and for so much.
constexpr double kFull = 0.8, kRoomier = 1.5;
constexpr std::uint32_t kLeastParts = 256;  // that there is room for

class ComputeRenderer final : public VulkanRenderer {
 public:
  explicit ComputeRenderer(const VulkanSettings& settings) : settings_(settings) {}

  // On the caller's device where there is one, else on its own.
  Status create(const VulkanDevice* lent) {
    STGS_TRY(lent != nullptr ? device_.borrow(*lent) : device_.create(settings_));
    segments_.create(device_, settings_.block_bytes);
    for (FrameSlot& slot : slots_) STGS_TRY(slot.create(device_));
    return {};
  }

  std::string name() const override { return "vulkan"; }

  Status draw(Timeline& timeline, double seconds, const std::vector<View>& views,
              RenderStats* stats) override {
    STGS_TRY(check_views(views));
    drawn_.clear();
    try {
      STGS_TRY(wait());
      FrameSlot& slot = slots_[0];
      STGS_TRY(prepare(timeline, seconds, views, slot.stats));
      STGS_TRY(draw_whole(timeline, seconds, views, slot));
      if (stats != nullptr) *stats = slot.stats;
      drawn_ = views;
    } catch (const std::exception& e) {
      return Status(code_of(e),
                    fmt::format("{}: cannot draw {} s: {}", timeline.name(), seconds, e.what()));
    }
    return {};
  }

  Status read(std::vector<Frame>& frames) override {
    try {
      frames.resize(drawn_.size());
      for (std::size_t i = 0; i < drawn_.size(); ++i) STGS_TRY(read_one(pictures_[i], frames[i]));
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("no memory for a picture: {}", e.what()));
    }
    return {};
  }

  Result<RenderProfile> profile() override {
    if (drawn_.empty()) return usage_error("there is nothing drawn to be drawn again");
    if (device_.timestamp_ns() == 0) return unsupported("the Vulkan device tells no times");
    try {
      return draw_step_by_step();
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("no memory to tell what a frame takes: {}", e.what()));
    }
  }

  Result<std::uint64_t> submit(Timeline& timeline, double seconds, const std::vector<View>& views,
                               const VulkanSubmission& to) override {
    STGS_TRY(check_views(views));
    STGS_TRY(check_submission(device_, views, to));
    drawn_.clear();
    try {
      STGS_TRY(look());
      FrameSlot& slot = slots_[(number_ + 1) % slots_.size()];
      if (slot.on_its_way()) {
        STGS_TRY(slot.wait());
        STGS_TRY(take(slot));
      }
      STGS_TRY(prepare(timeline, seconds, views, slot.stats));
      STGS_TRY(make_room(views, &to));
      STGS_TRY(record(views, &to, slot));
      for (std::size_t i = 0; i < views.size(); ++i) hand_over(pictures_[i], to.targets[i], slot);
      STGS_TRY(start(slot, to.wait, to.signal));
      slot.number = ++number_;
    } catch (const std::exception& e) {
      return Status(code_of(e),
                    fmt::format("{}: cannot draw {} s: {}", timeline.name(), seconds, e.what()));
    }
    return number_;
  }

  Result<VulkanFrame> last_completed() override {
    STGS_TRY(look());
    return ended_;
  }

  Status wait() override {
    for (std::size_t i = 1; i <= slots_.size(); ++i) {
      FrameSlot& slot = slots_[(number_ + i) % slots_.size()];
      if (!slot.on_its_way()) continue;
      STGS_TRY(slot.wait());
      STGS_TRY(take(slot));
    }
    return {};
  }

 private:
  // The pieces that are drawn, numbered in the order of ids, then put together by block.
  void list_parts(const std::vector<Timeline::SegmentRef>& needed) {
    std::vector<std::vector<Part>> of_block(segments_.memory().blocks());
    chunks_ = 0;
    for (const Timeline::SegmentRef& one : needed) {
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

  // Brings what is alive to the device, and says what of it is drawn.
  Status prepare(Timeline& timeline, double seconds, const std::vector<View>& views,
                 RenderStats& stats) {
    const auto begin = Clock::now();
    STGS_ASSIGN(const auto alive, segments_.make_resident(timeline, seconds));
    list_parts(alive);
    stats = {};
    stats.fetch_ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
    stats.stored = segments_.stored_primitives();
    stats.pending = segments_.waiting_primitives();
    sh_degree_ = timeline.reader().sh_degree();
    for (std::size_t i = 0; i < views.size(); ++i) {
      pictures_[i].set_size(views[i]);
    }
    return pipelines_.create(device_, sh_degree_);
  }

  std::uint64_t capacity() const {
    return std::min(buffers_.instance_capacity(), FrameBuffers::most_instances(device_));
  }

  // Of what frames share. Frames on their way use what there is, so that it grows between frames.
  Status grow(Buffer& buffer, std::uint64_t bytes, const Picture& picture, std::uint64_t at_once) {
    if (at_once > device_.most_range()) {
      return unsupported(
          "a picture of {}x{} pixels is larger than the Vulkan device's storage buffers ({} MiB); "
          "use backend 'cpu'",
          picture.width, picture.height, device_.most_range() >> 20);
    }
    if (bytes <= buffer.bytes()) return {};
    STGS_TRY(wait());
    return buffer.ensure(device_, bytes, Place::kDevice, device_.most_range() / 16 * 16);
  }

  // As far as the device's buffers have room. Each segment may leave a part of its last chunk.
  std::uint32_t chunks_at_fullest(std::size_t views) const {
    const auto& [primitives, segments] = segments_.peak();
    return static_cast<std::uint32_t>(
        std::min(primitives / kGroup + segments, FrameBuffers::most_chunks(device_) / views));
  }

  // For the pictures, in planes where `to` is null, and for what they are drawn with.
  Status make_room(const std::vector<View>& views, const VulkanSubmission* to) {
    FrameNeed need;
    need.chunks = std::max(chunks_, chunks_at_fullest(views.size())) *
                  static_cast<std::uint32_t>(views.size());
    need.parts = std::bit_ceil(std::max(static_cast<std::uint32_t>(parts_.size()), kLeastParts));
    for (std::size_t i = 0; i < views.size(); ++i) {
      Picture& p = pictures_[i];
      need.tiles += p.tiles();
      if (to == nullptr) {
        STGS_TRY(grow(p.planes, p.plane_bytes_together(), p, p.plane_bytes()));
        continue;
      }
      const std::uint64_t bytes = pixel_format(to->targets[i].colour.format).bytes * p.pixels();
      STGS_TRY(grow(p.packed, bytes, p, bytes));
      if (to->targets[i].depth) STGS_TRY(grow(p.depth, p.plane_bytes(), p, p.plane_bytes()));
    }
    if (buffers_.instance_capacity() == 0 && wanted_instances_ == 0) {
      wanted_instances_ = settings_.initial_instances > 0
                              ? settings_.initial_instances
                              : std::max(kLeastInstances, kInstancesEach * kGroup * need.chunks);
    }
    need.instances = std::min(wanted_instances_, FrameBuffers::most_instances(device_));
    if (need.fits(room_)) return {};
    STGS_TRY(wait());
    const FrameNeed wanted = need.with(room_);
    room_ = {};  // while it changes, and where it does not come to an end
    const Status made = buffers_.ensure(device_, wanted);
    if (made.ok()) {
      room_ = wanted;
      return made;
    }
    wanted_instances_ = 0;  // what is too much for this frame need not be for others
    if (need.chunks <= chunks_ * views.size()) return made;
    // Where the fullest moment has no room, that of this one may have.
    segments_.forget_fullest();
    buffers_ = {};
    return make_room(views, to);
  }

  FrameInput input_for(const std::vector<View>& views) const {
    FrameInput input = input_of(views, pictures_);
    input.chunks = chunks_;
    input.instance_capacity = static_cast<std::uint32_t>(capacity());
    return input;
  }

  // `to` as for make_room.
  std::vector<PictureBuffers> buffers_of(std::size_t views, const VulkanSubmission* to) const {
    std::vector<PictureBuffers> out;
    for (std::size_t i = 0; i < views; ++i) {
      out.push_back(pictures_[i].buffers(to == nullptr ? nullptr : &to->targets[i]));
    }
    return out;
  }

  Status record(const std::vector<View>& views, const VulkanSubmission* to, FrameSlot& slot) {
    STGS_TRY(slot.begin());
    segments_.record_copies(slot.draw());
    slot.capacity = capacity();
    const FrameInput input = input_for(views);
    const std::vector<PictureBuffers> pictures = buffers_of(views.size(), to);
    const FrameWork work{&input,      parts_,       blocks_,        sh_degree_,      pictures,
                         slot.told(), slot.times(), VK_NULL_HANDLE, has_fovea(views)};
    return slot.sets().record(device_, pipelines_, segments_.memory(), buffers_, work, slot.draw());
  }

  Result<RenderProfile> draw_step_by_step() {
    RenderProfile profile;
    if (copied_per_second_ == 0) {
      STGS_ASSIGN(copied_per_second_, copied_bytes_per_second(device_));
    }
    profile.bytes_per_second = copied_per_second_;
    const FrameSlot& slot = slots_[0];
    const FrameInput input = input_for(drawn_);
    const std::vector<PictureBuffers> pictures = buffers_of(drawn_.size(), nullptr);
    Times times;
    STGS_TRY(times.create(device_, kFrameSteps + 1));
    const FrameWork work{&input,      parts_,         blocks_,      sh_degree_,       pictures,
                         slot.told(), VK_NULL_HANDLE, times.pool(), has_fovea(drawn_)};
    FrameCommands sets;
    VkCommandBuffer commands = VK_NULL_HANDLE;
    STGS_TRY(device_.begin(&commands));
    barrier(device_, commands);
    STGS_TRY(sets.record(device_, pipelines_, segments_.memory(), buffers_, work, commands));
    STGS_TRY(device_.finish(commands));
    StepTimes ms{};
    STGS_TRY(times.between(ms));
    profile.steps = steps_of(work, slot.counts(), ms);
    return profile;
  }

  Status start(FrameSlot& slot, std::span<const VulkanSemaphore> wait,
               std::span<const VulkanSemaphore> signal) {
    // Before, for what is submitted is not to fail any more.
    slot.copied.reserve(segments_.buffers());
    STGS_TRY(slot.submit(wait, signal));
    segments_.take_copied(slot.copied);
    return {};
  }

  void hand_over(const Picture& picture, const VulkanTarget& to, const FrameSlot& slot) {
    copy_picture(device_, picture.packed.handle(), to.colour, slot.hand_over());
    if (to.depth) copy_picture(device_, picture.depth.handle(), *to.depth, slot.hand_over());
  }

  // Of a frame that has ended.
  Status count(FrameSlot& slot) {
    segments_.take_back(std::exchange(slot.copied, {}));
    const Counts counts = slot.counts();
    slot.stats.active = counts.alive;
    slot.stats.splats = counts.visible;
    return slot.add_times(slot.stats);
  }

  // Draws, and again with more room where the instances did not fit.
  Status draw_whole(const Timeline& timeline, double seconds, const std::vector<View>& views,
                    FrameSlot& slot) {
    for (;;) {
      STGS_TRY(make_room(views, nullptr));
      STGS_TRY(record(views, nullptr, slot));
      STGS_TRY(start(slot, {}, {}));
      STGS_TRY(slot.wait());
      const std::uint64_t listed = slot.counts().instances;
      if (listed <= slot.capacity) return count(slot);
      segments_.take_back(std::exchange(slot.copied, {}));
      const std::uint64_t most = FrameBuffers::most_instances(device_);
      if (listed > most) {
        return runtime_error(
            "{}: cannot draw {} s: the views' splats touch more tiles than a frame can list "
            "(2^{})",
            timeline.name(), seconds, std::bit_width(most) - 1);
      }
      wanted_instances_ = listed;
    }
  }

  // What the frames that have ended tell, in their order.
  Status look() {
    for (std::size_t i = 1; i <= slots_.size(); ++i) {
      FrameSlot& slot = slots_[(number_ + i) % slots_.size()];
      if (!slot.on_its_way()) continue;
      STGS_ASSIGN(const bool ended, slot.has_ended());
      if (!ended) return {};
      STGS_TRY(take(slot));
    }
    return {};
  }

  Status take(FrameSlot& slot) {
    STGS_TRY(count(slot));
    const std::uint64_t listed = slot.counts().instances;
    ended_ = {slot.number, listed <= slot.capacity, slot.stats};
    const auto instances = static_cast<double>(listed);
    if (instances > kFull * static_cast<double>(slot.capacity)) {
      wanted_instances_ =
          std::max(wanted_instances_, static_cast<std::uint64_t>(kRoomier * instances));
    }
    return {};
  }

  Status read_one(const Picture& picture, Frame& frame) {
    const std::uint64_t bytes = picture.plane_bytes_together();
    STGS_TRY(read_back_.ensure(device_, bytes, Place::kHost));
    VkCommandBuffer commands = VK_NULL_HANDLE;
    STGS_TRY(device_.begin(&commands));
    const VkBufferCopy region{0, 0, bytes};
    device_.vk.vkCmdCopyBuffer(commands, picture.planes.handle(), read_back_.handle(), 1, &region);
    barrier(device_, commands);
    STGS_TRY(device_.finish(commands));
    frame.colour.reshape(picture.width, picture.height, 3);
    frame.alpha.reshape(picture.width, picture.height, 1);
    frame.depth.reshape(picture.width, picture.height, 1);
    const std::uint8_t* from = read_back_.mapped();
    for (Image* image : {&frame.colour, &frame.alpha, &frame.depth}) {
      for (std::size_t at = 0; at < image->data.size(); at += picture.pixels()) {
        std::memcpy(image->data.data() + at, from, sizeof(float) * picture.pixels());
        from += picture.plane_bytes();
      }
    }
    return {};
  }

  VulkanSettings settings_;
  Device device_;  // outlives all that follows
  Pipelines pipelines_;
  SegmentCache segments_;
  FrameBuffers buffers_;
  FrameNeed room_;  // that buffers_ have
  std::uint64_t wanted_instances_ = 0;
  Buffer read_back_;
  std::array<Picture, kMaxViews> pictures_;
  std::vector<Part> parts_;  // of the moment
  std::vector<BlockParts> blocks_;
  std::uint32_t chunks_ = 0;
  int sh_degree_ = 0;
  std::vector<View> drawn_;       // by the last draw(), which succeeded
  double copied_per_second_ = 0;  // bytes; 0: not measured
  std::uint64_t number_ = 0;      // of the last frame that was submitted
  VulkanFrame ended_;
  std::array<FrameSlot, kMaxFramesInFlight> slots_;  // last: its destructor waits for the frames
};

Result<std::unique_ptr<VulkanRenderer>> make(const VulkanSettings& settings,
                                             const VulkanDevice* lent) {
  auto renderer = std::make_unique<ComputeRenderer>(settings);
  STGS_TRY(renderer->create(lent));
  return std::unique_ptr<VulkanRenderer>(std::move(renderer));
}

}  // namespace

Result<std::unique_ptr<Renderer>> make_vulkan_renderer(const VulkanSettings& settings) {
  STGS_ASSIGN(auto renderer, make(settings, nullptr));
  return std::unique_ptr<Renderer>(std::move(renderer));
}

Result<std::unique_ptr<VulkanRenderer>> make_vulkan_renderer(const VulkanDevice& device) {
  return make_vulkan_renderer(device, VulkanSettings{});
}

Result<std::unique_ptr<VulkanRenderer>> make_vulkan_renderer(const VulkanDevice& device,
                                                             const VulkanSettings& settings) {
  return make(settings, &device);
}

}  // namespace stgs::player
