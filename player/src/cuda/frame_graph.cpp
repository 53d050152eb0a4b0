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

static_assert(kMaxFrameViews == kMaxViews);

constexpr std::size_t kMinParts = 256;    // minimum capacity of a graph
constexpr std::size_t kPlanes = 5;        // per image: red, green, blue, alpha, depth
constexpr std::size_t kImageAlign = 256;  // bytes, as cudaMalloc aligns

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

// Returns the squares of 2 x 2 tiles.
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

Status FrameGraph::start(std::span<const View> views, std::span<const Part> parts,
                         Appearance appearance, int sh_degree, const Grids& grids,
                         const FrameBuffers& buffers, bool as_graph, cudaStream_t stream) {
  Config config;
  config.generation = buffers.generation();
  config.sh_degree = sh_degree;
  config.views = static_cast<std::uint32_t>(views.size());
  config.tiles = tiles_of(views);
  for (const View& view : views) config.fovea = config.fovea || view.fovea.has_value();
  for (const View& view : views) {
    config.max_tiles = std::max(config.max_tiles, tiles_of(view));
    config.max_squares = std::max(config.max_squares, squares_of(view));
  }
  config.parts = std::max(std::bit_ceil(std::max(parts.size() + 1, kMinParts)), current_.parts);
  lay_out_images(views);
  STGS_TRY(ensure_buffers(config));
  fill_input(views, parts, appearance);
  if (!as_graph) {
    return enqueue(grids, buffers, Measure::kStages, cudaEventRecordDefault, stream);
  }
  if (captured_ != current_) STGS_TRY(capture(grids, buffers, stream));
  return cuda_status(cudaGraphLaunch(graph_.get(), stream), "launching a graph");
}

void FrameGraph::lay_out_images(std::span<const View> views) {
  layouts_.clear();
  image_bytes_ = 0;
  for (const View& view : views) {
    const ImageLayout layout{image_bytes_, pixels_along(view.camera.width),
                             pixels_along(view.camera.height)};
    const std::size_t bytes = kPlanes * sizeof(float) * static_cast<std::size_t>(layout.width) *
                              static_cast<std::size_t>(layout.height);
    image_bytes_ += (bytes + kImageAlign - 1) / kImageAlign * kImageAlign;
    layouts_.push_back(layout);
  }
}

void FrameGraph::free_images() {
  images_.reset();
  captured_ = {};
}

Status FrameGraph::ensure_buffers(const Config& config) {
  // If addresses change, the graph must be captured again. The input holds those of the images.
  if (config != current_) captured_ = {};
  STGS_TRY(staging_.ensure(input_bytes(config.parts)));
  STGS_TRY(input_.ensure(input_bytes(config.parts)));
  STGS_TRY(counters_.ensure(sizeof(Counters)));
  STGS_TRY(images_.ensure(image_bytes_));
  for (Event& event : events_) {
    if (event.get() != nullptr) continue;
    STGS_TRY(cuda_status(cudaEventCreate(event.fresh()), "creating an event"));
  }
  current_ = config;
  return {};
}

void FrameGraph::fill_input(std::span<const View> views, std::span<const Part> parts,
                            Appearance appearance) {
  FrameInput frame{};
  std::uint32_t tiles = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const View& view = views[i];
    ViewInput& input = frame.views[i];
    input.camera = view.camera;
    input.centre = math::camera_centre(view.camera);
    input.background = view.background;
    input.encoding = appearance.encoding;
    input.kernel = appearance.kernel;
    input.width = layouts_[i].width;
    input.height = layouts_[i].height;
    input.tiles_x = tiles_along(view.camera.width);
    input.tiles_y = tiles_along(view.camera.height);
    input.first_tile = tiles;
    const Fovea fovea = fovea_of(view);
    input.fovea = fovea.centre;
    input.fovea_radius = fovea.radius;
    input.planes = reinterpret_cast<float*>(images_.data() + layouts_[i].offset);
    tiles += tiles_of(view);
  }
  frame.view_count = static_cast<std::uint32_t>(views.size());
  frame.parts = static_cast<std::uint32_t>(parts.size());
  if (!parts.empty()) {
    frame.chunks = parts.back().first_chunk + padded(parts.back().primitives) / kChunk;
  }
  std::memcpy(staging_.data(), &frame, sizeof(frame));
  if (!parts.empty()) {
    std::memcpy(staging_.data() + sizeof(frame), parts.data(), parts.size_bytes());
  }
}

Status FrameGraph::capture(const Grids& grids, const FrameBuffers& buffers, cudaStream_t stream) {
  graph_.reset();
  captured_ = {};
  STGS_TRY(cuda_status(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal),
                       "beginning a graph capture"));
  const Status enqueued =
      enqueue(grids, buffers, Measure::kStages, cudaEventRecordExternal, stream);
  Graph graph;
  const cudaError_t ended = cudaStreamEndCapture(stream, graph.fresh());
  STGS_TRY(enqueued);
  STGS_TRY(cuda_status(ended, "ending a graph capture"));
  STGS_TRY(
      cuda_status(cudaGraphInstantiate(graph_.fresh(), graph.get(), 0), "instantiating a graph"));
  captured_ = current_;
  return {};
}

Status FrameGraph::enqueue(const Grids& grids, const FrameBuffers& buffers, Measure measure,
                           unsigned event_flags, cudaStream_t stream) {
  const auto* const input = reinterpret_cast<const FrameInput*>(input_.data());
  const Workspace w = buffers.workspace(current_.tiles);
  const bool all = measure == Measure::kSteps;
  const auto record = [&](Step step) {
    const bool ends_stage =
        step == kBegin || step == kProject || step == kTileSort || step == kBlend;
    if (!all && !ends_stage) return Status();
    return cuda_status(cudaEventRecordWithFlags(events_[step].get(), stream, event_flags),
                       "recording an event");
  };
  STGS_TRY(record(kBegin));
  STGS_TRY(cuda_status(cudaMemcpyAsync(input_.data(), staging_.data(), input_bytes(current_.parts),
                                       cudaMemcpyHostToDevice, stream),
                       "uploading the input of a frame"));
  STGS_TRY(cuda_status(buffers.clear(stream), "clearing counters"));
  STGS_TRY(record(kClear));
  launch_select(input, w, grids, stream);
  STGS_TRY(record(kSelect));
  launch_project(current_.sh_degree, current_.views > 1, input, w, grids, stream);
  STGS_TRY(record(kProject));
  launch_depth_sort(w, grids, stream);
  STGS_TRY(record(kDepthSort));
  launch_list(current_.fovea, input, w, grids, stream);
  STGS_TRY(record(kList));
  launch_tile_sort(w, grids, stream);
  STGS_TRY(record(kTileSort));
  const BlendGrid grid = {current_.views, current_.max_tiles, current_.max_squares, current_.tiles,
                          current_.fovea};
  launch_blend(input, grid, w, all, stream);
  STGS_TRY(record(kBlend));
  STGS_TRY(cuda_status(cudaGetLastError(), "launching the kernels of a frame"));
  return cuda_status(cudaMemcpyAsync(counters_.data(), w.counters, sizeof(Counters),
                                     cudaMemcpyDeviceToHost, stream),
                     "reading back counters");
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
  frames.resize(layouts_.size());
  for (std::size_t i = 0; i < layouts_.size(); ++i) {
    const auto [offset, width, height] = layouts_[i];
    Frame& frame = frames[i];
    frame.colour.reshape(width, height, 3);
    frame.alpha.reshape(width, height, 1);
    frame.depth.reshape(width, height, 1);
    const std::uint8_t* from = images_.data() + offset;
    for (Image* image : {&frame.colour, &frame.alpha, &frame.depth}) {
      const std::size_t bytes = sizeof(float) * image->data.size();
      STGS_TRY(cuda_status(cudaMemcpy(image->data.data(), from, bytes, cudaMemcpyDeviceToHost),
                           "copying an image to the host"));
      from += bytes;
    }
  }
  return {};
}

Status FrameGraph::read(std::span<const CudaImage> to, cudaStream_t stream) const {
  if (to.size() != layouts_.size()) {
    return usage_error("expected {} images (one per rendered view), got {}", layouts_.size(),
                       to.size());
  }
  for (std::size_t i = 0; i < to.size(); ++i) {
    const auto [offset, width, height] = layouts_[i];
    const auto* const from = reinterpret_cast<const float*>(images_.data() + offset);
    const std::size_t row = sizeof(float) * static_cast<std::size_t>(width);
    const CudaPlane& rgba8 = to[i].rgba8;
    if (rgba8.data != nullptr) {
      STGS_TRY(cuda_status(pack_pixels(from, width, height, rgba8.data, rgba8.stride, stream),
                           "launching the packing of an image"));
    }
    for (std::size_t plane = 0; plane < kPlanes; ++plane) {
      const auto [data, stride] = to[i].planes[plane];
      if (data == nullptr) continue;
      const auto height_of = static_cast<std::size_t>(height);
      const float* const begin = from + plane * static_cast<std::size_t>(width) * height_of;
      STGS_TRY(cuda_status(cudaMemcpy2DAsync(data, stride, begin, row, row, height_of,
                                             cudaMemcpyDeviceToDevice, stream),
                           "starting the copy of an image"));
    }
  }
  return {};
}

}  // namespace stgs::player::cuda
