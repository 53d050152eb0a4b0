// SPDX-License-Identifier: Apache-2.0
#include "cuda/frame_graph.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "cuda/pack_pixels.h"
#include "views.h"

namespace stgs::player::cuda {
namespace {

static_assert(kMostViews == kMaxViews);

constexpr std::size_t kLeastParts = 256;    // that a graph has room for
constexpr std::size_t kPlanes = 5;          // of a picture: red, green, blue, alpha, depth
constexpr std::size_t kPictureAlign = 256;  // bytes, as cudaMalloc aligns

std::size_t input_bytes(std::size_t parts) {
  return sizeof(FrameInput) + parts * sizeof(Part);
}

int pixels_along(float side) {
  return static_cast<int>(std::lround(side));
}

int tiles_along(float side) {
  return (pixels_along(side) + kTilePixels - 1) / kTilePixels;
}

std::uint32_t tiles_of(const View& view) {
  return static_cast<std::uint32_t>(tiles_along(view.camera.width) *
                                    tiles_along(view.camera.height));
}

// Of 2 x 2 tiles.
std::uint32_t squares_of(const View& view) {
  return static_cast<std::uint32_t>((tiles_along(view.camera.width) + 1) / 2 *
                                    ((tiles_along(view.camera.height) + 1) / 2));
}

}  // namespace

std::uint32_t tiles_of(std::span<const View> views) {
  std::uint32_t tiles = 0;
  for (const View& view : views) tiles += tiles_of(view);
  return tiles;
}

Status FrameGraph::start(std::span<const View> views, std::span<const Part> parts, int sh_degree,
                         const Grids& grids, const FrameBuffers& buffers, bool as_graph,
                         cudaStream_t stream) {
  Made made;
  made.generation = buffers.generation();
  made.sh_degree = sh_degree;
  made.views = static_cast<std::uint32_t>(views.size());
  made.tiles = tiles_of(views);
  for (const View& view : views) made.fovea = made.fovea || view.fovea.has_value();
  for (const View& view : views) {
    made.most_tiles = std::max(made.most_tiles, tiles_of(view));
    made.most_squares = std::max(made.most_squares, squares_of(view));
  }
  made.parts = std::max(std::bit_ceil(std::max(parts.size() + 1, kLeastParts)), now_.parts);
  place_pictures(views);
  STGS_TRY(make_room(made));
  fill_input(views, parts);
  if (!as_graph) {
    return enqueue(grids, buffers, Telling::kStages, cudaEventRecordDefault, stream);
  }
  if (captured_ != now_) STGS_TRY(capture(grids, buffers, stream));
  return cuda_status(cudaGraphLaunch(graph_.get(), stream), "starting a frame");
}

void FrameGraph::place_pictures(std::span<const View> views) {
  places_.clear();
  picture_bytes_ = 0;
  for (const View& view : views) {
    const Place place{picture_bytes_, pixels_along(view.camera.width),
                      pixels_along(view.camera.height)};
    const std::size_t bytes = kPlanes * sizeof(float) * static_cast<std::size_t>(place.width) *
                              static_cast<std::size_t>(place.height);
    picture_bytes_ += (bytes + kPictureAlign - 1) / kPictureAlign * kPictureAlign;
    places_.push_back(place);
  }
}

Status FrameGraph::make_room(const Made& made) {
  // Where memory moves, the graph must be made again. That of the pictures is told by the input.
  if (made != now_) captured_ = {};
  STGS_TRY(staged_.ensure(input_bytes(made.parts)));
  STGS_TRY(input_.ensure(input_bytes(made.parts)));
  STGS_TRY(counted_.ensure(sizeof(Counters)));
  STGS_TRY(pictures_.ensure(picture_bytes_));
  for (Event& event : events_) {
    if (event.get() != nullptr) continue;
    STGS_TRY(cuda_status(cudaEventCreate(event.fresh()), "creating an event"));
  }
  now_ = made;
  return {};
}

void FrameGraph::fill_input(std::span<const View> views, std::span<const Part> parts) {
  FrameInput frame{};
  std::uint32_t tiles = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const View& view = views[i];
    ViewInput& input = frame.views[i];
    input.camera = view.camera;
    input.centre = math::camera_centre(view.camera);
    input.background = view.background;
    input.width = places_[i].width;
    input.height = places_[i].height;
    input.tiles_x = tiles_along(view.camera.width);
    input.tiles_y = tiles_along(view.camera.height);
    input.first_tile = tiles;
    const Fovea fovea = fovea_of(view);
    input.fovea = fovea.centre;
    input.fovea_radius = fovea.radius;
    input.planes = reinterpret_cast<float*>(pictures_.data() + places_[i].offset);
    tiles += tiles_of(view);
  }
  frame.view_count = static_cast<std::uint32_t>(views.size());
  frame.parts = static_cast<std::uint32_t>(parts.size());
  if (!parts.empty()) {
    frame.chunks = parts.back().first_chunk + padded(parts.back().primitives) / kChunk;
  }
  std::memcpy(staged_.data(), &frame, sizeof(frame));
  if (!parts.empty()) {
    std::memcpy(staged_.data() + sizeof(frame), parts.data(), parts.size_bytes());
  }
}

Status FrameGraph::capture(const Grids& grids, const FrameBuffers& buffers, cudaStream_t stream) {
  graph_.reset();
  captured_ = {};
  STGS_TRY(cuda_status(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal),
                       "beginning a graph"));
  const Status enqueued =
      enqueue(grids, buffers, Telling::kStages, cudaEventRecordExternal, stream);
  Graph graph;
  const cudaError_t ended = cudaStreamEndCapture(stream, graph.fresh());
  STGS_TRY(enqueued);
  STGS_TRY(cuda_status(ended, "recording a graph"));
  STGS_TRY(cuda_status(cudaGraphInstantiate(graph_.fresh(), graph.get(), 0), "making a graph"));
  captured_ = now_;
  return {};
}

Status FrameGraph::enqueue(const Grids& grids, const FrameBuffers& buffers, Telling telling,
                           unsigned event_flags, cudaStream_t stream) {
  const auto* const input = reinterpret_cast<const FrameInput*>(input_.data());
  const Workspace w = buffers.workspace(now_.tiles);
  const bool all = telling == Telling::kSteps;
  const auto told = [&](Step step) {
    const bool ends_stage =
        step == kBegin || step == kProject || step == kTileSort || step == kBlend;
    if (!all && !ends_stage) return Status();
    return cuda_status(cudaEventRecordWithFlags(events_[step].get(), stream, event_flags),
                       "recording an event");
  };
  STGS_TRY(told(kBegin));
  STGS_TRY(cuda_status(cudaMemcpyAsync(input_.data(), staged_.data(), input_bytes(now_.parts),
                                       cudaMemcpyHostToDevice, stream),
                       "sending a frame's input"));
  STGS_TRY(cuda_status(buffers.clear(stream), "clearing counters"));
  STGS_TRY(told(kClear));
  launch_select(input, w, grids, stream);
  STGS_TRY(told(kSelect));
  launch_project(now_.sh_degree, now_.views > 1, input, w, grids, stream);
  STGS_TRY(told(kProject));
  launch_depth_sort(w, grids, stream);
  STGS_TRY(told(kDepthSort));
  launch_list(now_.fovea, input, w, grids, stream);
  STGS_TRY(told(kList));
  launch_tile_sort(w, grids, stream);
  STGS_TRY(told(kTileSort));
  const BlendGrid grid = {now_.views, now_.most_tiles, now_.most_squares, now_.tiles, now_.fovea};
  launch_blend(input, grid, w, all, stream);
  STGS_TRY(told(kBlend));
  STGS_TRY(cuda_status(cudaGetLastError(), "starting the steps of a frame"));
  return cuda_status(cudaMemcpyAsync(counted_.data(), w.counters, sizeof(Counters),
                                     cudaMemcpyDeviceToHost, stream),
                     "asking for counts");
}

Status FrameGraph::time_between(Step from, Step to, double& ms) const {
  float between = 0;
  STGS_TRY(cuda_status(cudaEventElapsedTime(&between, events_[from].get(), events_[to].get()),
                       "reading the time of a step"));
  ms = between;
  return {};
}

Status FrameGraph::add_times(RenderStats& stats) const {
  double slice = 0, bin = 0, blend = 0;
  STGS_TRY(time_between(kBegin, kProject, slice));
  STGS_TRY(time_between(kProject, kTileSort, bin));
  STGS_TRY(time_between(kTileSort, kBlend, blend));
  stats.slice_ms += slice;
  stats.bin_ms += bin;
  stats.blend_ms += blend;
  stats.device_ms += slice + bin + blend;
  return {};
}

Status FrameGraph::read(std::vector<Frame>& frames) const {
  frames.resize(places_.size());
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const auto [offset, width, height] = places_[i];
    Frame& frame = frames[i];
    frame.colour.reshape(width, height, 3);
    frame.alpha.reshape(width, height, 1);
    frame.depth.reshape(width, height, 1);
    const std::uint8_t* from = pictures_.data() + offset;
    for (Image* image : {&frame.colour, &frame.alpha, &frame.depth}) {
      const std::size_t bytes = sizeof(float) * image->data.size();
      STGS_TRY(cuda_status(cudaMemcpy(image->data.data(), from, bytes, cudaMemcpyDeviceToHost),
                           "copying a picture"));
      from += bytes;
    }
  }
  return {};
}

Status FrameGraph::read(std::span<const CudaImage> to, cudaStream_t stream) const {
  if (to.size() != places_.size()) {
    return usage_error("{} views were drawn, not {}", places_.size(), to.size());
  }
  for (std::size_t i = 0; i < to.size(); ++i) {
    const auto [offset, width, height] = places_[i];
    const auto* const from = reinterpret_cast<const float*>(pictures_.data() + offset);
    const std::size_t row = sizeof(float) * static_cast<std::size_t>(width);
    const CudaPlane& rgba8 = to[i].rgba8;
    if (rgba8.data != nullptr) {
      STGS_TRY(cuda_status(pack_pixels(from, width, height, rgba8.data, rgba8.stride, stream),
                           "starting to pack a picture"));
    }
    for (std::size_t plane = 0; plane < kPlanes; ++plane) {
      const auto [data, stride] = to[i].planes[plane];
      if (data == nullptr) continue;
      const auto height_of = static_cast<std::size_t>(height);
      const float* const begin = from + plane * static_cast<std::size_t>(width) * height_of;
      STGS_TRY(cuda_status(cudaMemcpy2DAsync(data, stride, begin, row, row, height_of,
                                             cudaMemcpyDeviceToDevice, stream),
                           "starting to copy a picture"));
    }
  }
  return {};
}

}  // namespace stgs::player::cuda
