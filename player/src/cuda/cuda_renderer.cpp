// SPDX-License-Identifier: Apache-2.0
#include "cuda/cuda_renderer.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <exception>
#include <vector>

#include "cuda/segment_cache.h"
#include "cuda/view_slot.h"
#include "stgs/format/math/sh.h"
#include "views.h"

namespace stgs::player {
namespace {

using namespace cuda;
using Clock = std::chrono::steady_clock;

// Of splats in tiles, for each splat that there can be; a first guess.
constexpr std::uint64_t kInstancesEach = 4;
constexpr std::uint64_t kLeastInstances = std::uint64_t{1} << 20;

class CudaRenderer final : public Renderer {
 public:
  explicit CudaRenderer(const CudaSettings& settings) : settings_(settings) {}

  Status create() {
    int count = 0;
    if (const cudaError_t error = cudaGetDeviceCount(&count); error != cudaSuccess || count == 0) {
      (void)cudaGetLastError();
      return unsupported("there is no CUDA device ({}); use --backend cpu",
                         error != cudaSuccess ? cudaGetErrorString(error) : "none is found");
    }
    for (int degree = 0; degree <= math::kShMaxDegree; ++degree) {
      if (const cudaError_t error = find_grids(degree, grids_[degree]); error != cudaSuccess) {
        (void)cudaGetLastError();
        return unsupported("this build has no code for the CUDA device ({}); use --backend cpu",
                           cudaGetErrorString(error));
      }
    }
    STGS_TRY(cuda_status(cudaStreamCreateWithFlags(stream_.fresh(), cudaStreamNonBlocking),
                         "creating a stream"));
    return segments_.create();
  }

  std::string name() const override { return "cuda"; }

  Status draw(Timeline& timeline, double seconds, const std::vector<View>& views,
              RenderStats* stats) override {
    STGS_TRY(check_views(views));
    drawn_views_ = 0;
    try {
      RenderStats sums;
      const auto begin = Clock::now();
      STGS_ASSIGN(const auto alive, segments_.hold(timeline, seconds));
      list_parts(timeline, alive);
      sums.fetch_ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
      sums.stored = segments_.stored_primitives();
      STGS_TRY(draw_views(timeline, seconds, views));
      for (std::size_t i = 0; i < views.size(); ++i) {
        sums.alive = slots_[i].counted().alive;
        sums.drawn += slots_[i].counted().visible;
        STGS_TRY(slots_[i].add_times(sums));
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
      for (std::size_t i = 0; i < drawn_views_; ++i) STGS_TRY(slots_[i].read(frames[i]));
    } catch (const std::exception& e) {
      return runtime_error("no memory for a picture: {}", e.what());
    }
    return {};
  }

 private:
  void list_parts(const Timeline& timeline, const std::vector<Timeline::Needed>& needed) {
    parts_.clear();
    std::uint32_t chunks = 0;
    for (const Timeline::Needed& one : needed) {
      Part part{};
      part.primitives = timeline.reader().segments()[one.segment].primitives;
      if (part.primitives == 0) continue;
      part.at = segments_.at(one.segment);
      part.ticks = one.ticks;
      part.first_chunk = chunks;
      chunks += padded(part.primitives) / kChunk;
      parts_.push_back(part);
    }
    chunks_ = chunks;
  }

  FrameNeed need_of(const std::vector<View>& views) const {
    FrameNeed need;
    need.chunks = chunks_;
    for (const View& view : views) {
      const auto along = [](float side) {
        return (static_cast<std::uint32_t>(side + 0.5f) + kTilePixels - 1) / kTilePixels;
      };
      need.tiles = std::max(need.tiles, along(view.camera.width) * along(view.camera.height));
    }
    if (buffers_.instance_capacity() == 0) {
      need.instances = settings_.instances > 0
                           ? settings_.instances
                           : std::max(kLeastInstances, kInstancesEach * kChunk * chunks_);
    }
    return need;
  }

  // Draws, and again with more room where a view's instances did not fit.
  Status draw_views(const Timeline& timeline, double seconds, const std::vector<View>& views) {
    const int degree = timeline.reader().sh_degree();
    FrameNeed need = need_of(views);
    for (;;) {
      STGS_TRY(buffers_.ensure(need));
      Status started;
      for (std::size_t i = 0; i < views.size() && started.ok(); ++i) {
        started = slots_[i].start(views[i], parts_, degree, grids_[degree], buffers_,
                                  settings_.graph, stream_.get());
      }
      // Also after an error: what has begun uses the buffers.
      const cudaError_t ended = cudaStreamSynchronize(stream_.get());
      STGS_TRY(started);
      STGS_TRY(cuda_status(ended, "drawing"));
      need.instances = 0;
      for (std::size_t i = 0; i < views.size(); ++i) {
        need.instances = std::max<std::uint64_t>(need.instances, slots_[i].counted().instances);
      }
      if (need.instances > kMaxInstances) {
        return runtime_error(
            "{}: cannot draw {} s: the view's splats touch more tiles than a frame can list (2^26)",
            timeline.name(), seconds);
      }
      if (need.instances <= buffers_.instance_capacity()) return {};
    }
  }

  CudaSettings settings_;
  Stream stream_;
  std::array<Grids, math::kShMaxDegree + 1> grids_;
  SegmentCache segments_;
  FrameBuffers buffers_;
  std::array<ViewSlot, kMaxViews> slots_;
  std::vector<Part> parts_;  // of the moment
  std::uint32_t chunks_ = 0;
  std::size_t drawn_views_ = 0;
};

}  // namespace

Result<std::unique_ptr<Renderer>> make_cuda_renderer(const CudaSettings& settings) {
  auto renderer = std::make_unique<CudaRenderer>(settings);
  STGS_TRY(renderer->create());
  return std::unique_ptr<Renderer>(std::move(renderer));
}

}  // namespace stgs::player
