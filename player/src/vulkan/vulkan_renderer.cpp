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
#include "vulkan/frame_parts.h"
#include "vulkan/frame_profile.h"
#include "vulkan/frame_slot.h"
#include "vulkan/frame_views.h"
#include "vulkan/image_readback.h"
#include "vulkan/segment_cache.h"
#include "vulkan/timestamps.h"

namespace stgs::player {
namespace {

using namespace vulkan;
using Clock = std::chrono::steady_clock;

// Initial estimate of the tile instances.
constexpr std::uint64_t kInstancesPerPrimitive = 4;
constexpr std::uint64_t kMinInstances = std::uint64_t{1} << 18;
// Submitted frames cannot be repeated, so their buffers grow before they are full: from this fill
// level on, by this factor.
constexpr double kNearlyFull = 0.8, kGrowth = 1.5;
constexpr std::uint32_t kMinParts = 256;  // capacity

class ComputeRenderer final : public VulkanRenderer {
 public:
  explicit ComputeRenderer(const VulkanSettings& settings) : settings_(settings) {}

  // Uses the caller's device, or creates one if `lent` is null.
  Status create(const VulkanDevice* lent) {
    device_.renderer_memory = &memory_;
    STGS_TRY(lent != nullptr ? device_.borrow(*lent) : device_.create(settings_));
    segments_.create(device_, settings_.block_bytes);
    for (FrameSlot& slot : slots_) STGS_TRY(slot.create(device_));
    return {};
  }

  std::string name() const override { return "vulkan"; }

  Status draw(Timeline& timeline, double seconds, const std::vector<View>& views,
              RenderStats* stats) override {
    STGS_TRY(check_views(views, timeline));
    rendered_.clear();
    try {
      STGS_TRY(wait());
      FrameSlot& slot = slots_[0];
      const Status drawn = within_limit(timeline, [&]() -> Status {
        STGS_TRY(prepare(timeline, seconds, views, slot.stats));
        return draw_complete(timeline, seconds, views, slot);
      });
      STGS_TRY(drawn);
      if (stats != nullptr) *stats = slot.stats;
      rendered_ = views;
    } catch (const std::exception& e) {
      return Status(code_of(e),
                    fmt::format("{}: cannot render {} s: {}", timeline.name(), seconds, e.what()));
    }
    return {};
  }

  Status read(std::vector<Frame>& frames) override {
    try {
      frames.resize(rendered_.size());
      for (std::size_t i = 0; i < rendered_.size(); ++i)
        STGS_TRY(readback_.read(device_, images_[i], frames[i]));
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("cannot read the images: {}", e.what()));
    }
    return {};
  }

  Result<RenderProfile> profile() override {
    if (rendered_.empty()) return usage_error("no frame has been rendered yet");
    if (device_.timestamp_ns() == 0)
      return unsupported("the Vulkan device does not support timestamps");
    try {
      return profile_steps();
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("cannot profile the frame: {}", e.what()));
    }
  }

  Result<std::uint64_t> submit(Timeline& timeline, double seconds, const std::vector<View>& views,
                               const VulkanSubmission& to) override {
    STGS_TRY(check_views(views, timeline));
    STGS_TRY(check_submission(device_, views, to));
    rendered_.clear();
    try {
      STGS_TRY(collect_completed());
      FrameSlot& slot = slots_[(number_ + 1) % slots_.size()];
      if (slot.in_flight()) {
        STGS_TRY(slot.wait());
        STGS_TRY(record_result(slot));
      }
      const Status ready = within_limit(timeline, [&]() -> Status {
        STGS_TRY(prepare(timeline, seconds, views, slot.stats));
        return ensure_buffers(views, &to);
      });
      STGS_TRY(ready);
      STGS_TRY(record(views, &to, slot));
      for (std::size_t i = 0; i < views.size(); ++i) copy_output(images_[i], to.targets[i], slot);
      STGS_TRY(start(slot, to.wait, to.signal));
      slot.number = ++number_;
    } catch (const std::exception& e) {
      return Status(code_of(e),
                    fmt::format("{}: cannot render {} s: {}", timeline.name(), seconds, e.what()));
    }
    return number_;
  }

  Result<VulkanFrame> last_completed() override {
    STGS_TRY(collect_completed());
    return last_completed_;
  }

  Status wait() override {
    for (std::size_t i = 1; i <= slots_.size(); ++i) {
      FrameSlot& slot = slots_[(number_ + i) % slots_.size()];
      if (!slot.in_flight()) continue;
      STGS_TRY(slot.wait());
      STGS_TRY(record_result(slot));
    }
    return {};
  }

 private:
  template <typename Draw>
  Status within_limit(const Timeline& timeline, const Draw& draw) {
    return draw_within_limit(memory_, timeline, capacity_.parts > 0, draw,
                             [this] { return free_memory(); });
  }

  // Frees the images and the working memory of frames.
  Status free_memory() {
    STGS_TRY(wait());
    buffers_ = {};
    capacity_ = {};
    images_ = {};
    readback_ = {};
    target_instances_ = 0;
    return {};
  }

  // Makes the active segments resident and lists the parts to render.
  Status prepare(Timeline& timeline, double seconds, const std::vector<View>& views,
                 RenderStats& stats) {
    const auto begin = Clock::now();
    appearance_ = appearance_of(timeline.metadata());
    STGS_ASSIGN(const auto refs, segments_.make_resident(timeline, seconds));
    parts_ = list_parts(segments_, refs);
    stats = {};
    stats.fetch_ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
    stats.stored = segments_.stored_primitives();
    stats.pending = segments_.pending_primitives();
    sh_degree_ = timeline.reader().sh_degree();
    for (std::size_t i = 0; i < views.size(); ++i) {
      images_[i].set_size(views[i]);
    }
    return pipelines_.create(device_, sh_degree_);
  }

  std::uint64_t capacity() const {
    return std::min(buffers_.instance_capacity(), FrameBuffers::max_instances(device_));
  }

  // Returns the chunks at the peak, limited by the device's buffers. The last chunk of each segment
  // may be incomplete.
  std::uint32_t peak_chunks(std::size_t views) const {
    const auto& [primitives, segments] = segments_.peak();
    return static_cast<std::uint32_t>(
        std::min(primitives / kGroup + segments, FrameBuffers::max_chunks(device_) / views));
  }

  // Grows the working buffers and the image buffers; those are planes if `to` is null.
  Status ensure_buffers(const std::vector<View>& views, const VulkanSubmission* to) {
    FrameNeed need;
    need.chunks = std::max(parts_.chunks, peak_chunks(views.size())) *
                  static_cast<std::uint32_t>(views.size());
    need.parts =
        std::bit_ceil(std::max(static_cast<std::uint32_t>(parts_.parts.size()), kMinParts));
    const std::span<ViewImage> images(images_.data(), views.size());
    for (const ViewImage& image : images) need.tiles += image.tiles();
    STGS_TRY(grow_images(device_, images, to, [this] { return wait(); }));
    if (buffers_.instance_capacity() == 0 && target_instances_ == 0) {
      target_instances_ =
          settings_.initial_instances > 0
              ? settings_.initial_instances
              : std::max(kMinInstances, kInstancesPerPrimitive * kGroup * need.chunks);
    }
    need.instances = std::min(target_instances_, FrameBuffers::max_instances(device_));
    if (need.fits(capacity_)) return {};
    STGS_TRY(wait());
    const FrameNeed target = need.with(capacity_);
    capacity_ = {};  // unknown if ensure() fails or throws
    Status status = buffers_.ensure(device_, target);
    if (status.ok()) {
      capacity_ = target;
      return status;
    }
    target_instances_ = 0;  // other frames may need less
    if (need.chunks <= parts_.chunks * views.size()) return status;
    // The peak does not fit, but this frame may.
    segments_.forget_peak();
    buffers_ = {};
    return ensure_buffers(views, to);
  }

  FrameInput input_for(const std::vector<View>& views) const {
    FrameInput input = input_of(views, images_);
    for (std::uint32_t i = 0; i < input.views; ++i) {
      input.view[i].encoding = appearance_.encoding;
      input.view[i].kernel = appearance_.kernel;
    }
    input.chunks = parts_.chunks;
    input.instance_capacity = static_cast<std::uint32_t>(capacity());
    return input;
  }

  // `to` as for ensure_buffers().
  std::vector<ImageBuffers> buffers_of(std::size_t views, const VulkanSubmission* to) const {
    std::vector<ImageBuffers> out;
    for (std::size_t i = 0; i < views; ++i) {
      out.push_back(images_[i].buffers(to == nullptr ? nullptr : &to->targets[i]));
    }
    return out;
  }

  Status record(const std::vector<View>& views, const VulkanSubmission* to, FrameSlot& slot) {
    STGS_TRY(slot.begin());
    segments_.record_copies(slot.draw());
    slot.capacity = capacity();
    const FrameInput input = input_for(views);
    const std::vector<ImageBuffers> images = buffers_of(views.size(), to);
    const FrameWork work{&input,          parts_.parts,         parts_.blocks,     sh_degree_,
                         images,          slot.counts_buffer(), slot.timestamps(), VK_NULL_HANDLE,
                         has_fovea(views)};
    return slot.sets().record(device_, pipelines_, segments_.memory(), buffers_, work, slot.draw());
  }

  Result<RenderProfile> profile_steps() {
    RenderProfile profile;
    if (bandwidth_ == 0) {
      STGS_ASSIGN(bandwidth_, measure_bandwidth(device_));
    }
    profile.bytes_per_second = bandwidth_;
    const FrameSlot& slot = slots_[0];
    const FrameInput input = input_for(rendered_);
    const std::vector<ImageBuffers> images = buffers_of(rendered_.size(), nullptr);
    Timestamps timestamps;
    STGS_TRY(timestamps.create(device_, kFrameSteps + 1));
    const FrameWork work{&input,
                         parts_.parts,
                         parts_.blocks,
                         sh_degree_,
                         images,
                         slot.counts_buffer(),
                         VK_NULL_HANDLE,
                         timestamps.pool(),
                         has_fovea(rendered_)};
    FrameCommands sets;
    VkCommandBuffer commands = VK_NULL_HANDLE;
    STGS_TRY(device_.begin(&commands));
    barrier(device_, commands);
    STGS_TRY(sets.record(device_, pipelines_, segments_.memory(), buffers_, work, commands));
    STGS_TRY(device_.finish(commands));
    StepTimes ms{};
    STGS_TRY(timestamps.between(ms));
    profile.steps = steps_of(work, slot.counts(), ms);
    return profile;
  }

  Status start(FrameSlot& slot, std::span<const VulkanSemaphore> wait,
               std::span<const VulkanSemaphore> signal) {
    // Reserve first: nothing may fail after the submission.
    slot.staging.reserve(segments_.staging_buffers());
    STGS_TRY(slot.submit(wait, signal));
    segments_.take_staging(slot.staging);
    return {};
  }

  void copy_output(const ViewImage& image, const VulkanTarget& to, const FrameSlot& slot) {
    copy_to_image(device_, image.packed.handle(), to.colour, slot.output());
    if (to.depth) copy_to_image(device_, image.depth.handle(), *to.depth, slot.output());
  }

  // Collects the results of a completed frame.
  Status count(FrameSlot& slot) {
    segments_.recycle(std::exchange(slot.staging, {}));
    const Counts counts = slot.counts();
    slot.stats.active = counts.active;
    slot.stats.splats = counts.visible;
    return slot.add_times(slot.stats);
  }

  // Renders, and repeats with larger buffers if the instances did not fit.
  Status draw_complete(const Timeline& timeline, double seconds, const std::vector<View>& views,
                       FrameSlot& slot) {
    for (;;) {
      STGS_TRY(ensure_buffers(views, nullptr));
      STGS_TRY(record(views, nullptr, slot));
      STGS_TRY(start(slot, {}, {}));
      STGS_TRY(slot.wait());
      const std::uint64_t listed = slot.counts().instances;
      if (listed <= slot.capacity) return count(slot);
      segments_.recycle(std::exchange(slot.staging, {}));
      const std::uint64_t limit = FrameBuffers::max_instances(device_);
      if (listed > limit) {
        return runtime_error(
            "{}: cannot render {} s: the splats touch {} tiles, more than the limit of 2^{} per "
            "frame; render fewer or smaller views",
            timeline.name(), seconds, listed, std::bit_width(limit) - 1);
      }
      target_instances_ = listed;
    }
  }

  // Records the results of completed frames, in order.
  Status collect_completed() {
    for (std::size_t i = 1; i <= slots_.size(); ++i) {
      FrameSlot& slot = slots_[(number_ + i) % slots_.size()];
      if (!slot.in_flight()) continue;
      STGS_ASSIGN(const bool completed, slot.has_completed());
      if (!completed) return {};
      STGS_TRY(record_result(slot));
    }
    return {};
  }

  Status record_result(FrameSlot& slot) {
    STGS_TRY(count(slot));
    const std::uint64_t listed = slot.counts().instances;
    last_completed_ = {slot.number, listed <= slot.capacity, slot.stats};
    const auto instances = static_cast<double>(listed);
    if (instances > kNearlyFull * static_cast<double>(slot.capacity)) {
      target_instances_ =
          std::max(target_instances_, static_cast<std::uint64_t>(kGrowth * instances));
    }
    return {};
  }

  VulkanSettings settings_;
  RendererMemory memory_;  // outlives the buffers
  Device device_;          // outlives the following members
  Pipelines pipelines_;
  SegmentCache segments_;
  FrameBuffers buffers_;
  FrameNeed capacity_;  // of buffers_
  std::uint64_t target_instances_ = 0;
  ImageReadback readback_;
  std::array<ViewImage, kMaxViews> images_;
  FrameParts parts_;  // of the last frame
  int sh_degree_ = 0;
  Appearance appearance_;       // of the scene
  std::vector<View> rendered_;  // by the last successful draw()
  double bandwidth_ = 0;        // bytes/s; 0: not measured
  std::uint64_t number_ = 0;    // of the last submitted frame
  VulkanFrame last_completed_;
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
