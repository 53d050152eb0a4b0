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

// A first guess: splats at most, tiles of each, and tiles at least.
constexpr std::uint64_t kFirstSplats = std::uint64_t{1} << 21;
constexpr std::uint64_t kInstancesEach = 4;
constexpr std::uint64_t kLeastInstances = std::uint64_t{1} << 20;

class CudaRenderer final : public Renderer {
 public:
  explicit CudaRenderer(const CudaSettings& settings) : settings_(settings) {}
  ~CudaRenderer() override {
    if (handed_over_.get() != nullptr) (void)cudaEventSynchronize(handed_over_.get());
  }

  Status create() {
    int count = 0;
    if (const cudaError_t error = cudaGetDeviceCount(&count); error != cudaSuccess || count == 0) {
      (void)cudaGetLastError();
      return unsupported("there is no CUDA device ({}); use backend 'cpu'",
                         error != cudaSuccess ? cudaGetErrorString(error) : "none is found");
    }
    for (int degree = 0; degree <= math::kShMaxDegree; ++degree) {
      if (const cudaError_t error = find_grids(degree, grids_[degree]); error != cudaSuccess) {
        (void)cudaGetLastError();
        return unsupported("this build has no code for the CUDA device ({}); use backend 'cpu'",
                           cudaGetErrorString(error));
      }
    }
    STGS_TRY(cuda_status(cudaGetDevice(&device_), "asking for the device"));
    STGS_TRY(cuda_status(cudaStreamCreateWithFlags(stream_.fresh(), cudaStreamNonBlocking),
                         "creating a stream"));
    STGS_TRY(cuda_status(cudaEventCreateWithFlags(handed_over_.fresh(), cudaEventDisableTiming),
                         "creating an event"));
    return segments_.create();
  }

  std::string name() const override { return "cuda"; }

  Status draw(Timeline& timeline, double seconds, const std::vector<View>& views,
              RenderStats* stats) override {
    STGS_TRY(check_views(views));
    STGS_TRY(check_device());
    drawn_ = false;
    try {
      RenderStats sums;
      const auto begin = Clock::now();
      STGS_ASSIGN(const auto alive, segments_.make_resident(timeline, seconds));
      list_parts(timeline, alive);
      sums.fetch_ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
      sums.stored = segments_.stored_primitives();
      sums.pending = segments_.waiting_primitives();
      STGS_TRY(draw_views(timeline, seconds, views));
      sums.active = frame_.counted().alive;
      sums.splats = frame_.counted().visible;
      STGS_TRY(frame_.add_times(sums));
      if (stats != nullptr) *stats = sums;
    } catch (const std::exception& e) {
      return Status(code_of(e),
                    fmt::format("{}: cannot draw {} s: {}", timeline.name(), seconds, e.what()));
    }
    drawn_ = true;
    return {};
  }

  Status read(std::vector<Frame>& frames) override {
    try {
      if (drawn_) return frame_.read(frames);
      frames.clear();
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("no memory for a picture: {}", e.what()));
    }
    return {};
  }

  Status read_cuda(const std::vector<CudaImage>& to, CUstream_st* stream) override {
    if (!drawn_) return usage_error("there is nothing drawn to be read");
    STGS_TRY(check_device());
    const Status started = frame_.read(to, stream);
    // Also after an error: what has begun uses the pictures.
    const cudaError_t recorded = cudaEventRecord(handed_over_.get(), stream);
    STGS_TRY(started);
    return cuda_status(recorded, "recording an event");
  }

  Result<RenderProfile> profile() override {
    if (!drawn_) return usage_error("there is nothing drawn to be drawn again");
    try {
      return frame_.profile(grids_[degree_], buffers_, stream_.get());
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("no memory to tell what a frame takes: {}", e.what()));
    }
  }

 private:
  Status check_device() const {
    int current = -1;
    STGS_TRY(cuda_status(cudaGetDevice(&current), "asking for the device"));
    if (current == device_) return {};
    return usage_error(
        "the renderer is CUDA device {}'s, and device {} is the thread's current one", device_,
        current);
  }

  void list_parts(const Timeline& timeline, const std::vector<Timeline::SegmentRef>& needed) {
    parts_.clear();
    std::uint32_t chunks = 0;
    for (const Timeline::SegmentRef& one : needed) {
      Part part{};
      part.primitives = timeline.reader().segments()[one.segment].primitives;
      if (part.primitives == 0) continue;
      part.memory = segments_.at(one.segment);
      part.ticks = one.ticks;
      part.first_chunk = chunks;
      chunks += padded(part.primitives) / kChunk;
      parts_.push_back(part);
    }
    chunks_ = chunks;
  }

  static std::uint64_t instances_guess(std::uint64_t splats) {
    return std::max(kLeastInstances, kInstancesEach * splats);
  }

  FrameNeed need_of(const std::vector<View>& views) const {
    FrameNeed need;
    need.chunks = std::max(chunks_, chunks_at_fullest());
    need.tiles = tiles_of(views);
    if (buffers_.generation() > 0) return need;
    const auto guess = [](std::uint64_t wanted, std::uint64_t guessed) {
      return wanted > 0 ? wanted : guessed;
    };
    need.splats = guess(settings_.initial_splats,
                        std::min(kFirstSplats, std::uint64_t{need.chunks} * kChunk * views.size()));
    need.instances = guess(settings_.initial_instances, instances_guess(need.splats));
    return need;
  }

  // Each segment may leave a part of its last chunk.
  std::uint32_t chunks_at_fullest() const {
    const auto& [primitives, segments] = segments_.peak();
    return static_cast<std::uint32_t>(
        std::min(primitives / kChunk + segments, kMaxSplats / kChunk));
  }

  // Where the fullest moment has no room, that of this one may have.
  Status make_room(FrameNeed& need) {
    const Status made = buffers_.ensure(need);
    if (made.ok() || need.chunks <= chunks_) return made;
    segments_.forget_fullest();
    buffers_.reset();
    need.chunks = chunks_;
    need.splats = std::min(need.splats, splats_at_most(kMaxViews));
    need.instances = std::min(need.instances, instances_guess(need.splats));
    return buffers_.ensure(need);
  }

  std::uint64_t splats_at_most(std::size_t views) const {
    return std::uint64_t{chunks_} * kChunk * views;
  }

  // Draws, and again with more room where splats or instances did not fit.
  Status draw_views(const Timeline& timeline, double seconds, const std::vector<View>& views) {
    degree_ = timeline.reader().sh_degree();
    if (splats_at_most(views.size()) > kMaxSplats) {
      return runtime_error(
          "{}: cannot draw {} s: more primitives may be alive than fit a frame (2^{} of all views)",
          timeline.name(), seconds, kSplatBits);
    }
    FrameNeed need = need_of(views);
    // The pictures before may still be read.
    STGS_TRY(cuda_status(cudaEventSynchronize(handed_over_.get()), "waiting for pictures' reader"));
    for (;;) {
      STGS_TRY(make_room(need));
      const Status started = frame_.start(views, parts_, degree_, grids_[degree_], buffers_,
                                          settings_.use_graph, stream_.get());
      // Also after an error: what has begun uses the buffers.
      const cudaError_t ended = cudaStreamSynchronize(stream_.get());
      STGS_TRY(started);
      STGS_TRY(cuda_status(ended, "drawing"));
      need.splats = frame_.counted().visible;
      need.instances = frame_.counted().instances;
      if (need.instances > kMaxInstances * views.size()) {
        return runtime_error(
            "{}: cannot draw {} s: the splats touch more tiles than a frame can list (2^26 a view)",
            timeline.name(), seconds);
      }
      if (need.splats <= buffers_.splat_capacity() &&
          need.instances <= buffers_.instance_capacity()) {
        return {};
      }
    }
  }

  CudaSettings settings_;
  int device_ = 0;
  Stream stream_;
  Event handed_over_;  // to whom read_cuda() has
  std::array<Grids, math::kShMaxDegree + 1> grids_;
  SegmentCache segments_;
  FrameBuffers buffers_;
  FrameGraph frame_;
  std::vector<Part> parts_;  // of the moment
  std::uint32_t chunks_ = 0;
  int degree_ = 0;
  bool drawn_ = false;
};

}  // namespace

Result<std::unique_ptr<Renderer>> make_cuda_renderer(const CudaSettings& settings) {
  auto renderer = std::make_unique<CudaRenderer>(settings);
  STGS_TRY(renderer->create());
  return std::unique_ptr<Renderer>(std::move(renderer));
}

}  // namespace stgs::player
