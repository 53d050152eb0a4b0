// SPDX-License-Identifier: Apache-2.0
// A frame, which is one time seen from up to kMaxFrameViews views: its input, its stages as a CUDA
// graph, and its images.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "cuda/device_buffer.h"
#include "cuda/frame_buffers.h"
#include "stgs/player/cuda_renderer.h"
#include "views.h"

namespace stgs::player::cuda {

// One thread; the current device.
class FrameGraph {
 public:
  // `memory` as for GrowingBuffer.
  explicit FrameGraph(RendererMemory* memory)
      : staging_(memory), counters_(memory), input_(memory), images_(memory) {}
  // Starts rendering the parts. The previous frame must have completed.
  Status start(std::span<const View> views, std::span<const Part> parts, Appearance appearance,
               int sh_degree, const Grids& grids, const FrameBuffers& buffers, bool as_graph,
               cudaStream_t stream);
  // Requires, like the following functions, that the stream has been synchronised.
  // Returns the counters of the frame.
  const Counters& counters() const { return *reinterpret_cast<const Counters*>(counters_.data()); }
  // Adds the times of the stages.
  Status add_times(RenderStats& stats) const;
  // Copies the images to the host.
  Status read(std::vector<Frame>& frames) const;
  // Starts copying the images to device memory.
  Status read(std::span<const CudaImage> to, cudaStream_t stream) const;
  // Frees the images. There is no frame then.
  void free_images();
  // Renders the frame again step by step and returns the times of the steps. Waits.
  Result<RenderProfile> profile(const Grids& grids, const FrameBuffers& buffers,
                                cudaStream_t stream);

 private:
  // The configuration that a graph is captured for.
  struct Config {
    std::uint64_t generation = 0;  // of the buffers; 0: no graph
    int sh_degree = 0;
    std::uint32_t views = 0, tiles = 0;
    std::uint32_t max_tiles = 0, max_squares = 0;  // maximum over the views
    bool fovea = false;                            // a view has a fovea
    std::size_t parts = 0;                         // capacity of the input
    bool operator==(const Config&) const = default;
  };
  // The location of an image, bytes from the beginning of all images.
  struct ImageLayout {
    std::size_t offset = 0;
    int width = 0, height = 0;
  };
  // Steps after which an event is recorded.
  enum Step { kBegin, kClear, kSelect, kProject, kDepthSort, kList, kTileSort, kBlend, kSteps };
  enum class Measure { kStages, kSteps };  // kSteps also counts the work of the blend

  void lay_out_images(std::span<const View> views);
  Status ensure_buffers(const Config& config);
  void fill_input(std::span<const View> views, std::span<const Part> parts, Appearance appearance);
  Status capture(const Grids& grids, const FrameBuffers& buffers, cudaStream_t stream);
  // Enqueues all steps, with events between them.
  Status enqueue(const Grids& grids, const FrameBuffers& buffers, Measure measure,
                 unsigned event_flags, cudaStream_t stream);
  Status time_between(Step from, Step to, double& ms) const;

  Config current_, captured_;
  std::vector<ImageLayout> layouts_;
  std::size_t image_bytes_ = 0;
  PinnedBuffer staging_, counters_;
  DeviceBuffer input_, images_;
  Event events_[kSteps];
  GraphExec graph_;
};

// Returns the number of tiles of all views.
std::uint32_t tiles_of(std::span<const View> views);

}  // namespace stgs::player::cuda
