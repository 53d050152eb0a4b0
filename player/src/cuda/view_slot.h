// SPDX-License-Identifier: Apache-2.0
// One of the views that a call draws: what it is given, its stages as a graph, and its picture.
#pragma once

#include <cstdint>
#include <span>

#include "cuda/device_buffer.h"
#include "cuda/frame_buffers.h"
#include "stgs/player/renderer.h"

namespace stgs::player::cuda {

// One thread; the current device. Views that share buffers are drawn on one stream.
class ViewSlot {
 public:
  // Starts drawing the parts. Not while it draws already.
  Status start(const View& view, std::span<const Part> parts, int sh_degree, const Grids& grids,
               const FrameBuffers& buffers, bool as_graph, cudaStream_t stream);
  // What was counted, once the stream has been waited for.
  const Counters& counted() const { return *reinterpret_cast<const Counters*>(counted_.data()); }
  // Adds the stages' times, likewise.
  Status add_times(RenderStats& stats) const;
  // Copies the picture to the host, likewise.
  Status read(Frame& frame) const;

 private:
  // What the graph was made for.
  struct Made {
    std::uint64_t generation = 0;  // of the buffers; 0: there is none
    int sh_degree = 0, width = 0, height = 0;
    std::size_t parts = 0;  // that the input has room for
    bool operator==(const Made&) const = default;
  };
  enum Stage { kBegin, kSliced, kBinned, kBlended, kStages };

  Status make_room(const Made& made);
  Status fill_input(const View& view, std::span<const Part> parts);
  Status capture(const Grids& grids, const FrameBuffers& buffers, cudaStream_t stream);
  // Starts all stages, each between events.
  Status enqueue(const Grids& grids, const FrameBuffers& buffers, unsigned event_flags,
                 cudaStream_t stream);
  std::uint32_t tiles() const;

  Made now_, captured_;
  PinnedBuffer staged_, counted_;
  DeviceBuffer input_, picture_;
  Event events_[kStages];
  GraphExec graph_;
};

}  // namespace stgs::player::cuda
