// SPDX-License-Identifier: Apache-2.0
// A frame, which is one moment from up to kMostViews views: what it is given, its stages as a
// graph, and its pictures.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "cuda/device_buffer.h"
#include "cuda/frame_buffers.h"
#include "stgs/player/renderer.h"

namespace stgs::player::cuda {

// One thread; the current device.
class FrameGraph {
 public:
  // Starts drawing the parts. Not while it draws already.
  Status start(std::span<const View> views, std::span<const Part> parts, int sh_degree,
               const Grids& grids, const FrameBuffers& buffers, bool as_graph, cudaStream_t stream);
  // What was counted, once the stream has been waited for.
  const Counters& counted() const { return *reinterpret_cast<const Counters*>(counted_.data()); }
  // Adds the stages' times, likewise.
  Status add_times(RenderStats& stats) const;
  // Copies the pictures to the host, likewise.
  Status read(std::vector<Frame>& frames) const;
  // Starts to copy them to memory of the device, likewise.
  Status read(std::span<const CudaImage> to, cudaStream_t stream) const;
  // What the steps take, likewise; draws the frame once more for it, and waits.
  Result<RenderProfile> profile(const Grids& grids, const FrameBuffers& buffers,
                                cudaStream_t stream);

 private:
  // What the graph was made for.
  struct Made {
    std::uint64_t generation = 0;  // of the buffers; 0: there is none
    int sh_degree = 0;
    std::uint32_t views = 0, tiles = 0;
    std::uint32_t most_tiles = 0, most_squares = 0;  // of a view
    bool fovea = false;                              // whether a view has one
    std::size_t parts = 0;                           // that the input has room for
    bool operator==(const Made&) const = default;
  };
  // Where a picture lies, bytes from the beginning of all of them.
  struct Place {
    std::size_t offset = 0;
    int width = 0, height = 0;
  };
  // After which time is told.
  enum Step { kBegin, kClear, kSelect, kProject, kDepthSort, kList, kTileSort, kBlend, kSteps };
  enum class Telling { kStages, kSteps };  // kSteps: and counts

  void place_pictures(std::span<const View> views);
  Status make_room(const Made& made);
  void fill_input(std::span<const View> views, std::span<const Part> parts);
  Status capture(const Grids& grids, const FrameBuffers& buffers, cudaStream_t stream);
  // Starts all steps, with events between.
  Status enqueue(const Grids& grids, const FrameBuffers& buffers, Telling telling,
                 unsigned event_flags, cudaStream_t stream);
  Status time_between(Step from, Step to, double& ms) const;

  Made now_, captured_;
  std::vector<Place> places_;
  std::size_t picture_bytes_ = 0;
  PinnedBuffer staged_, counted_;
  DeviceBuffer input_, pictures_;
  Event events_[kSteps];
  GraphExec graph_;
};

// Of the views' pictures, together.
std::uint32_t tiles_of(std::span<const View> views);

}  // namespace stgs::player::cuda
