// SPDX-License-Identifier: Apache-2.0
#include "cuda/cuda_renderer.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <exception>
#include <vector>

#include "cuda/frame_graph.h"
#include "cuda/segment_cache.h"
#include "stgs/format/math/sh.h"
#include "views.h"

namespace stgs::player {
namespace {

using namespace cuda;
using Clock = std::chrono::steady_clock;

// Initial estimates: maximum splats, instances per splat, and minimum instances.
constexpr std::uint64_t kMaxInitialSplats = std::uint64_t{1} << 21;
constexpr std::uint64_t kInstancesPerSplat = 4;
constexpr std::uint64_t kMinInstances = std::uint64_t{1} << 20;

class FrameGraphRenderer final : public CudaRenderer {
 public:
  explicit FrameGraphRenderer(const CudaSettings& settings)
      : settings_(settings), segments_(&memory_), buffers_(&memory_), frame_(&memory_) {}
  ~FrameGraphRenderer() override {
    if (read_done_.get() != nullptr) (void)cudaEventSynchronize(read_done_.get());
  }

  Status create() {
    int count = 0;
    if (const cudaError_t error = cudaGetDeviceCount(&count); error != cudaSuccess || count == 0) {
      (void)cudaGetLastError();
      return unsupported(
          "no CUDA device found ({}); use backend 'cpu'",
          error != cudaSuccess ? cudaGetErrorString(error) : "the device count is 0");
    }
    for (int degree = 0; degree <= math::kShMaxDegree; ++degree) {
      const cudaError_t error = find_grids(degree, grids_[degree]);
      if (error == cudaErrorNoKernelImageForDevice || error == cudaErrorInvalidDeviceFunction ||
          error == cudaErrorUnsupportedPtxVersion) {
        (void)cudaGetLastError();
        return unsupported("this build has no code for the CUDA device ({}); use backend 'cpu'",
                           cudaGetErrorString(error));
      }
      STGS_TRY(cuda_status(error, "loading the kernels"));
    }
    STGS_TRY(cuda_status(cudaGetDevice(&device_), "querying the current device"));
    STGS_TRY(cuda_status(cudaStreamCreateWithFlags(stream_.fresh(), cudaStreamNonBlocking),
                         "creating a stream"));
    STGS_TRY(cuda_status(cudaEventCreateWithFlags(read_done_.fresh(), cudaEventDisableTiming),
                         "creating an event"));
    return segments_.create();
  }

  std::string name() const override { return "cuda"; }

  Status draw(Timeline& timeline, double seconds, const std::vector<View>& views,
              RenderStats* stats) override {
    STGS_TRY(check_views(views, timeline));
    STGS_TRY(check_device());
    has_frame_ = false;
    try {
      RenderStats sums;
      STGS_TRY(draw_within_limit(
          memory_, timeline, buffers_.splat_capacity() > 0,
          [&] { return draw_frame(timeline, seconds, views, sums); },
          [this] { return free_memory(); }));
      if (stats != nullptr) *stats = sums;
    } catch (const std::exception& e) {
      return Status(code_of(e),
                    fmt::format("{}: cannot render {} s: {}", timeline.name(), seconds, e.what()));
    }
    has_frame_ = true;
    return {};
  }

  Status read(std::vector<Frame>& frames) override {
    try {
      if (has_frame_) return frame_.read(frames);
      frames.clear();
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("cannot read the images: {}", e.what()));
    }
    return {};
  }

  Status read_cuda(const std::vector<CudaImage>& to, CUstream_st* stream) override {
    if (!has_frame_) return usage_error("no frame has been rendered yet");
    STGS_TRY(check_device());
    const Status started = frame_.read(to, stream);
    // Also after an error, since some copies may have started.
    const cudaError_t recorded = cudaEventRecord(read_done_.get(), stream);
    STGS_TRY(started);
    return cuda_status(recorded, "recording an event");
  }

  Result<RenderProfile> profile() override {
    if (!has_frame_) return usage_error("no frame has been rendered yet");
    try {
      return frame_.profile(grids_[degree_], buffers_, stream_.get());
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("cannot profile the frame: {}", e.what()));
    }
  }

 private:
  Status draw_frame(Timeline& timeline, double seconds, const std::vector<View>& views,
                    RenderStats& sums) {
    sums = {};
    const auto begin = Clock::now();
    STGS_ASSIGN(const auto refs, segments_.make_resident(timeline, seconds));
    list_parts(timeline, refs);
    sums.fetch_ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
    sums.stored = segments_.stored_primitives();
    sums.pending = segments_.pending_primitives();
    STGS_TRY(draw_views(timeline, seconds, views));
    sums.active = frame_.counters().active;
    sums.splats = frame_.counters().visible;
    return frame_.add_times(sums);
  }

  // Frees the images and the working memory of frames.
  Status free_memory() {
    STGS_TRY(cuda_status(cudaEventSynchronize(read_done_.get()),
                         "waiting for copies of the previous images"));
    buffers_.reset();
    frame_.free_images();
    return {};
  }

  Status check_device() const {
    int current = -1;
    STGS_TRY(cuda_status(cudaGetDevice(&current), "querying the current device"));
    if (current == device_) return {};
    return usage_error(
        "the renderer was created on CUDA device {}, but device {} is current on this thread; call "
        "cudaSetDevice first",
        device_, current);
  }

  void list_parts(const Timeline& timeline, const std::vector<Timeline::SegmentRef>& refs) {
    parts_.clear();
    std::uint32_t chunks = 0;
    for (const Timeline::SegmentRef& ref : refs) {
      Part part{};
      part.primitives = timeline.reader().segments()[ref.segment].primitives;
      if (part.primitives == 0) continue;
      part.memory = segments_.at(ref.segment);
      part.ticks = ref.ticks;
      part.first_chunk = chunks;
      chunks += padded(part.primitives) / kChunk;
      parts_.push_back(part);
    }
    chunks_ = chunks;
  }

  static std::uint64_t estimated_instances(std::uint64_t splats) {
    return std::max(kMinInstances, kInstancesPerSplat * splats);
  }

  FrameNeed need_of(const std::vector<View>& views) const {
    FrameNeed need;
    need.chunks = std::max(chunks_, peak_chunks());
    need.tiles = tiles_of(views);
    if (buffers_.splat_capacity() > 0) return need;
    const auto setting_or = [](std::uint64_t setting, std::uint64_t estimate) {
      return setting > 0 ? setting : estimate;
    };
    need.splats =
        setting_or(settings_.initial_splats,
                   std::min(kMaxInitialSplats, std::uint64_t{need.chunks} * kChunk * views.size()));
    need.instances = setting_or(settings_.initial_instances, estimated_instances(need.splats));
    return need;
  }

  // Returns the chunks at the peak. The last chunk of each segment may be incomplete.
  std::uint32_t peak_chunks() const {
    const auto& [primitives, segments] = segments_.peak();
    return static_cast<std::uint32_t>(
        std::min(primitives / kChunk + segments, kMaxSplats / kChunk));
  }

  // Grows the buffers. If the peak does not fit, falls back to this frame.
  Status ensure_buffers(FrameNeed& need) {
    Status status = buffers_.ensure(need);
    if (status.ok() || need.chunks <= chunks_) return status;
    segments_.forget_peak();
    buffers_.reset();
    need.chunks = chunks_;
    need.splats = std::min(need.splats, max_splats(kMaxViews));
    need.instances = std::min(need.instances, estimated_instances(need.splats));
    return buffers_.ensure(need);
  }

  std::uint64_t max_splats(std::size_t views) const {
    return std::uint64_t{chunks_} * kChunk * views;
  }

  // Renders, and repeats with larger buffers if splats or instances did not fit.
  Status draw_views(const Timeline& timeline, double seconds, const std::vector<View>& views) {
    degree_ = timeline.reader().sh_degree();
    if (max_splats(views.size()) > kMaxSplats) {
      return runtime_error(
          "{}: cannot render {} s: more primitives may be active than fit a frame (2^{} over all "
          "views); render fewer views",
          timeline.name(), seconds, kSplatBits);
    }
    FrameNeed need = need_of(views);
    // The previous images may still be read.
    STGS_TRY(cuda_status(cudaEventSynchronize(read_done_.get()),
                         "waiting for copies of the previous images"));
    for (;;) {
      STGS_TRY(ensure_buffers(need));
      const Status started =
          frame_.start(views, parts_, appearance_of(timeline.metadata()), degree_, grids_[degree_],
                       buffers_, settings_.use_graph, stream_.get());
      // Also after an error, since kernels that have started use the buffers.
      const cudaError_t ended = cudaStreamSynchronize(stream_.get());
      STGS_TRY(started);
      STGS_TRY(cuda_status(ended, "rendering"));
      need.splats = frame_.counters().visible;
      need.instances = frame_.counters().instances;
      if (need.instances > kMaxInstances * views.size()) {
        return runtime_error(
            "{}: cannot render {} s: the splats touch {} tiles, more than the limit of 2^26 per "
            "view; render smaller views",
            timeline.name(), seconds, need.instances);
      }
      if (need.splats <= buffers_.splat_capacity() &&
          need.instances <= buffers_.instance_capacity()) {
        return {};
      }
    }
  }

  CudaSettings settings_;
  RendererMemory memory_;  // outlives the buffers
  int device_ = 0;
  Stream stream_;
  Event read_done_;  // of the copies of read_cuda()
  std::array<Grids, math::kShMaxDegree + 1> grids_;
  SegmentCache segments_;
  FrameBuffers buffers_;
  FrameGraph frame_;
  std::vector<Part> parts_;  // of the frame
  std::uint32_t chunks_ = 0;
  int degree_ = 0;
  bool has_frame_ = false;
};

}  // namespace

Result<std::unique_ptr<Renderer>> make_cuda_renderer(const CudaSettings& settings) {
  auto renderer = std::make_unique<FrameGraphRenderer>(settings);
  STGS_TRY(renderer->create());
  return std::unique_ptr<Renderer>(std::move(renderer));
}

}  // namespace stgs::player
