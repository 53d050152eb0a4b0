// SPDX-License-Identifier: Apache-2.0
#include "cuda/view_slot.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace stgs::player::cuda {
namespace {

constexpr int kPlanes = 5;  // of a picture: red, green, blue, alpha, depth

std::size_t pixels_of(int width, int height) {
  return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
}

std::size_t input_bytes(std::size_t parts) {
  return sizeof(ViewInput) + parts * sizeof(Part);
}

int tiles_along(int pixels) {
  return (pixels + kTilePixels - 1) / kTilePixels;
}

}  // namespace

std::uint32_t ViewSlot::tiles() const {
  return static_cast<std::uint32_t>(tiles_along(now_.width) * tiles_along(now_.height));
}

Status ViewSlot::start(const View& view, std::span<const Part> parts, int sh_degree,
                       const Grids& grids, const FrameBuffers& buffers, bool as_graph,
                       cudaStream_t stream) {
  Made made;
  made.generation = buffers.generation();
  made.sh_degree = sh_degree;
  made.width = static_cast<int>(std::lround(view.camera.width));
  made.height = static_cast<int>(std::lround(view.camera.height));
  made.parts = std::max(std::bit_ceil(parts.size() + 1), now_.parts);
  STGS_TRY(make_room(made));
  STGS_TRY(fill_input(view, parts));
  if (!as_graph) return enqueue(grids, buffers, cudaEventRecordDefault, stream);
  if (captured_ != now_) STGS_TRY(capture(grids, buffers, stream));
  return cuda_status(cudaGraphLaunch(graph_.get(), stream), "starting a frame");
}

Status ViewSlot::make_room(const Made& made) {
  // Where memory moves, the graph must be made again.
  if (made != now_) captured_ = {};
  STGS_TRY(staged_.ensure(input_bytes(made.parts)));
  STGS_TRY(input_.ensure(input_bytes(made.parts)));
  STGS_TRY(counted_.ensure(sizeof(Counters)));
  STGS_TRY(picture_.ensure(kPlanes * sizeof(float) * pixels_of(made.width, made.height)));
  for (Event& event : events_) {
    if (event.get() != nullptr) continue;
    STGS_TRY(cuda_status(cudaEventCreate(event.fresh()), "creating an event"));
  }
  now_ = made;
  return {};
}

Status ViewSlot::fill_input(const View& view, std::span<const Part> parts) {
  ViewInput input{};
  input.camera = view.camera;
  input.centre = math::camera_centre(view.camera);
  input.background = view.background;
  input.width = now_.width;
  input.height = now_.height;
  input.tiles_x = tiles_along(now_.width);
  input.tiles_y = tiles_along(now_.height);
  input.parts = static_cast<std::uint32_t>(parts.size());
  if (!parts.empty()) {
    input.chunks = parts.back().first_chunk + padded(parts.back().primitives) / kChunk;
  }
  std::memcpy(staged_.data(), &input, sizeof(input));
  if (!parts.empty()) {
    std::memcpy(staged_.data() + sizeof(input), parts.data(), parts.size_bytes());
  }
  return {};
}

Status ViewSlot::capture(const Grids& grids, const FrameBuffers& buffers, cudaStream_t stream) {
  graph_.reset();
  captured_ = {};
  STGS_TRY(cuda_status(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal),
                       "beginning a graph"));
  const Status enqueued = enqueue(grids, buffers, cudaEventRecordExternal, stream);
  Graph graph;
  const cudaError_t ended = cudaStreamEndCapture(stream, graph.fresh());
  STGS_TRY(enqueued);
  STGS_TRY(cuda_status(ended, "recording a graph"));
  STGS_TRY(cuda_status(cudaGraphInstantiate(graph_.fresh(), graph.get(), 0), "making a graph"));
  captured_ = now_;
  return {};
}

Status ViewSlot::enqueue(const Grids& grids, const FrameBuffers& buffers, unsigned event_flags,
                         cudaStream_t stream) {
  const auto* const input = reinterpret_cast<const ViewInput*>(input_.data());
  const Workspace w = buffers.workspace(tiles());
  const Picture picture{reinterpret_cast<float*>(picture_.data())};
  const auto told = [&](Stage stage) {
    return cuda_status(cudaEventRecordWithFlags(events_[stage].get(), stream, event_flags),
                       "recording an event");
  };
  STGS_TRY(told(kBegin));
  STGS_TRY(cuda_status(cudaMemcpyAsync(input_.data(), staged_.data(), input_bytes(now_.parts),
                                       cudaMemcpyHostToDevice, stream),
                       "sending a view"));
  STGS_TRY(cuda_status(buffers.clear(stream), "clearing counters"));
  launch_project(now_.sh_degree, input, w, grids, stream);
  STGS_TRY(told(kSliced));
  launch_depth_sort(w, grids, stream);
  launch_list(input, w, grids, stream);
  launch_tile_sort(w, grids, stream);
  STGS_TRY(told(kBinned));
  launch_blend(input, tiles(), w, picture, stream);
  STGS_TRY(told(kBlended));
  STGS_TRY(cuda_status(cudaGetLastError(), "starting the stages of a frame"));
  return cuda_status(cudaMemcpyAsync(counted_.data(), w.counters, sizeof(Counters),
                                     cudaMemcpyDeviceToHost, stream),
                     "asking for counts");
}

Status ViewSlot::add_times(RenderStats& stats) const {
  double* const sums[] = {&stats.slice_ms, &stats.bin_ms, &stats.blend_ms};
  for (int stage = kBegin; stage < kBlended; ++stage) {
    float ms = 0;
    STGS_TRY(cuda_status(cudaEventElapsedTime(&ms, events_[stage].get(), events_[stage + 1].get()),
                         "reading the time of a stage"));
    *sums[stage] += ms;
    stats.device_ms += ms;
  }
  return {};
}

Status ViewSlot::read(Frame& frame) const {
  frame.colour.reshape(now_.width, now_.height, 3);
  frame.alpha.reshape(now_.width, now_.height, 1);
  frame.depth.reshape(now_.width, now_.height, 1);
  const std::uint8_t* from = picture_.data();
  for (Image* image : {&frame.colour, &frame.alpha, &frame.depth}) {
    const std::size_t bytes = sizeof(float) * image->data.size();
    STGS_TRY(cuda_status(cudaMemcpy(image->data.data(), from, bytes, cudaMemcpyDeviceToHost),
                         "copying a picture"));
    from += bytes;
  }
  return {};
}

}  // namespace stgs::player::cuda
