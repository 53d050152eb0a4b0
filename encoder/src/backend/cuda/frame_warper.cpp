// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "backend/cuda/frame_warp.h"
#include "backend/cuda/lane_pool.h"
#include "backend/cuda/memory.h"
#include "backend/cuda/select_gpu.h"
#include "geometry/frame_warp.h"
#include "geometry/warp_tables.h"

namespace stgs::encoder {
namespace {

using cuda::cuda_status;
using cuda::DeviceArray;
using geometry::AreaSpan;
using geometry::ChromaTaps;
using geometry::PackedImage;
using geometry::WarpCamera;
using geometry::WarpPosition;
using geometry::YuvFrame;
using geometry::YuvPlanes;
using geometry::YuvRule;

constexpr std::size_t kMaxWarpLanes = 8;  // frames at a time

std::size_t pixels_in(int width, int height) {
  return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
}

// Copies a table to the device, in the order of the stream.
template <typename T>
Status upload(const std::vector<T>& values, DeviceArray<T>& array, const cuda::Stream& stream) {
  STGS_TRY(array.ensure(values.size()));
  return cuda_status(cudaMemcpyAsync(array.data(), values.data(), values.size() * sizeof(T),
                                     cudaMemcpyHostToDevice, stream),
                     "uploading a table");
}

// The device memory of the tables and of one lane for a camera, bytes.
struct WarpBytes {
  std::size_t tables, lane;
};

WarpBytes bytes_of(const WarpCamera& camera) {
  const std::size_t source = pixels_in(camera.source_width, camera.source_height);
  // Of two bytes per sample: planes; of four channels: the source; the undistorted image.
  constexpr std::size_t kLaneBytes = 3 + 4 + 3;
  return {camera.map_x == nullptr ? 0 : source * sizeof(WarpPosition),
          source * kLaneBytes + 3 * pixels_in(camera.width, camera.height)};
}

// The budget of the device memory. Thread-safe.
class WarpMemory {
 public:
  // `limit`: bytes.
  void set_limit(std::size_t limit) { limit_ = limit; }
  // Reserves the tables of a camera, and returns whether they fit next to one lane.
  bool reserve(const WarpBytes& camera) {
    const std::lock_guard lock(mutex_);
    const std::size_t lane = std::max(lane_, camera.lane);
    if (camera.tables > limit_ - tables_ || lane > limit_ - tables_ - camera.tables) return false;
    tables_ += camera.tables;
    lane_ = lane;
    return true;
  }
  void release(std::size_t tables) {
    const std::lock_guard lock(mutex_);
    tables_ -= tables;
  }
  std::size_t max_lanes() const {
    const std::lock_guard lock(mutex_);
    const std::size_t fitting = lane_ == 0 ? kMaxWarpLanes : (limit_ - tables_) / lane_;
    return std::clamp<std::size_t>(fitting, 1, kMaxWarpLanes);
  }

 private:
  mutable std::mutex mutex_;
  std::size_t limit_ = 0, tables_ = 0;
  std::size_t lane_ = 0;  // of the largest camera
};

// The tables of a camera on the device.
struct CameraTables {
  int source_width = 0, source_height = 0, width = 0, height = 0;
  bool undistorts = false, scales = false;
  DeviceArray<WarpPosition> positions;
  DeviceArray<AreaSpan> columns, rows;

  Status set(const WarpCamera& camera) {
    source_width = camera.source_width;
    source_height = camera.source_height;
    width = camera.width;
    height = camera.height;
    undistorts = camera.map_x != nullptr;
    scales = width != source_width || height != source_height;
    cuda::Stream stream;
    STGS_TRY(stream.create());
    if (undistorts) STGS_TRY(upload_positions(camera, stream));
    if (scales) {
      STGS_TRY(upload(geometry::area_spans(source_width, width), columns, stream));
      STGS_TRY(upload(geometry::area_spans(source_height, height), rows, stream));
    }
    return stream.wait();
  }

 private:
  // In blocks, whose copies return when they have read the host memory.
  Status upload_positions(const WarpCamera& camera, const cuda::Stream& stream) {
    constexpr std::size_t kBlock = std::size_t{1} << 20;
    const std::size_t count = pixels_in(source_width, source_height);
    STGS_TRY(positions.ensure(count));
    std::vector<WarpPosition> made;
    for (std::size_t first = 0; first < count; first += made.size()) {
      made.clear();
      for (std::size_t i = first; i < std::min(first + kBlock, count); ++i)
        made.push_back(geometry::warp_position(camera.map_x[i], camera.map_y[i]));
      STGS_TRY(cuda_status(
          cudaMemcpyAsync(positions.data() + first, made.data(), made.size() * sizeof(WarpPosition),
                          cudaMemcpyHostToDevice, stream),
          "uploading a table"));
    }
    return {};
  }
};

// The memory and the stream of one frame.
class WarpLane {
 public:
  WarpLane(int gpu, const std::int16_t* weights) : gpu_(gpu), weights_(weights) {}

  template <typename Frame>
  Status run(const CameraTables& camera, const Frame& frame, std::uint8_t* out) {
    // The device is a setting of the thread.
    STGS_TRY(cuda_status(cudaSetDevice(gpu_), "choosing the GPU"));
    STGS_TRY(stream_.create());
    const Status status = start(camera, frame, out);
    // Also after an error, because copies read the memory of the caller.
    const Status waited = stream_.wait();
    return status.ok() ? waited : status;
  }

 private:
  template <typename Frame>
  Status start(const CameraTables& camera, const Frame& frame, std::uint8_t* out) {
    STGS_TRY(take(frame));
    STGS_TRY(warp(camera));
    STGS_TRY(cuda_status(cudaGetLastError(), "starting to convert a frame"));
    return cuda_status(cudaMemcpyAsync(out, image_.data, 3 * pixels_in(image_.width, image_.height),
                                       cudaMemcpyDeviceToHost, stream_),
                       "reading a frame");
  }

  Status take(const PackedImage& image) {
    const std::size_t row = pixels_in(image.width, image.channels);
    STGS_TRY(source_.ensure(row * static_cast<std::size_t>(image.height)));
    image_ = {source_.data(), image.width, image.height, row, image.channels};
    return copy_rows(image.data, image.stride, row, image.height, source_.data());
  }

  Status take(const YuvFrame& frame) {
    YuvPlanes planes = frame.planes;
    STGS_TRY(frame.on_device ? wait_for_decoder() : upload_planes(planes));
    if (rule_ != frame.rule) {
      rule_.reset();
      STGS_TRY(upload(frame.rule->columns, columns_, stream_));
      STGS_TRY(upload(frame.rule->rows, rows_, stream_));
      rule_ = frame.rule;
    }
    STGS_TRY(source_.ensure(3 * pixels_in(planes.width, planes.height)));
    cuda::launch_yuv_to_bgr(planes, rule_->coefficients, columns_.data(), rows_.data(),
                            frame.quarters, source_.data(), stream_);
    const bool turned = frame.quarters % 2 == 1;
    set_image(source_.data(), turned ? planes.height : planes.width,
              turned ? planes.width : planes.height);
    return {};
  }

  // The decoder writes on the default stream.
  Status wait_for_decoder() {
    STGS_TRY(decoded_.create());
    STGS_TRY(cuda_status(cudaEventRecord(decoded_, cudaStreamLegacy), "waiting for the decoder"));
    return cuda_status(cudaStreamWaitEvent(stream_, decoded_, 0), "waiting for the decoder");
  }

  Status upload_planes(YuvPlanes& planes) {
    const std::size_t sample = planes.bits == 8 ? 1 : 2;
    const std::size_t luma = pixels_in(planes.width, planes.height) * sample;
    const std::size_t row = sample * static_cast<std::size_t>(planes.width);
    const std::size_t chroma_row = row / 2;
    STGS_TRY(planes_.ensure(luma + luma / 2));
    std::uint8_t* const u = planes_.data() + luma;
    std::uint8_t* const v = u + luma / 4;
    const int rows = planes.height / 2;
    STGS_TRY(copy_rows(planes.luma, planes.luma_stride, row, planes.height, planes_.data()));
    STGS_TRY(copy_rows(planes.u, planes.chroma_stride, chroma_row, rows, u));
    STGS_TRY(copy_rows(planes.v, planes.chroma_stride, chroma_row, rows, v));
    planes.luma = planes_.data();
    planes.u = u;
    planes.v = v;
    planes.luma_stride = row;
    planes.chroma_stride = chroma_row;
    return {};
  }

  Status copy_rows(const void* from, std::size_t stride, std::size_t row, int rows, void* to) {
    return cuda_status(cudaMemcpy2DAsync(to, row, from, stride, row, static_cast<std::size_t>(rows),
                                         cudaMemcpyHostToDevice, stream_),
                       "uploading a frame");
  }

  // Undistorts and scales image_.
  Status warp(const CameraTables& camera) {
    if (image_.width != camera.source_width || image_.height != camera.source_height) {
      return invalid_file("a frame differs in size from the first (expected {}x{}, got {}x{})",
                          camera.source_width, camera.source_height, image_.width, image_.height);
    }
    if (camera.undistorts) {
      STGS_TRY(undistorted_.ensure(3 * pixels_in(image_.width, image_.height)));
      cuda::launch_undistort(image_, camera.positions.data(), weights_, undistorted_.data(),
                             stream_);
      set_image(undistorted_.data(), image_.width, image_.height);
    }
    if (!camera.scales) return {};
    STGS_TRY(scaled_.ensure(3 * pixels_in(camera.width, camera.height)));
    cuda::launch_scale(image_, camera.columns.data(), camera.rows.data(), camera.width,
                       camera.height, scaled_.data(), stream_);
    set_image(scaled_.data(), camera.width, camera.height);
    return {};
  }

  void set_image(const std::uint8_t* data, int width, int height) {
    image_ = {data, width, height, 3 * static_cast<std::size_t>(width), 3};
  }

  const int gpu_;
  const std::int16_t* const weights_;
  cuda::Stream stream_;
  cuda::Event decoded_;
  DeviceArray<std::uint8_t> planes_, source_, undistorted_, scaled_;
  DeviceArray<ChromaTaps> columns_, rows_;
  std::shared_ptr<const YuvRule> rule_;  // of columns_ and rows_
  PackedImage image_{};                  // the latest step
};

class WarpLanes {
 public:
  Status create(int gpu) {
    gpu_ = gpu;
    std::size_t free = 0, total = 0;
    STGS_TRY(cuda_status(cudaMemGetInfo(&free, &total), "querying the GPU"));
    memory_.set_limit(free / 4);
    cuda::Stream stream;
    STGS_TRY(stream.create());
    STGS_TRY(upload(geometry::warp_weights(), weights_, stream));
    return stream.wait();
  }

  template <typename Frame>
  Status run(const CameraTables& camera, const Frame& frame, std::uint8_t* out) {
    return lanes_.take()->run(camera, frame, out);
  }

  int gpu() const { return gpu_; }
  WarpMemory& memory() { return memory_; }

 private:
  int gpu_ = 0;
  WarpMemory memory_;
  DeviceArray<std::int16_t> weights_;
  cuda::LanePool<WarpLane> lanes_{
      [this] { return std::make_unique<WarpLane>(gpu_, weights_.data()); },
      [this] { return memory_.max_lanes(); }};
};

class CudaFrameWarp final : public geometry::FrameWarp {
 public:
  // The memory of the camera has been reserved.
  CudaFrameWarp(WarpLanes& lanes, std::size_t table_bytes)
      : lanes_(lanes), table_bytes_(table_bytes) {}
  ~CudaFrameWarp() override { lanes_.memory().release(table_bytes_); }
  Status set(const WarpCamera& camera) { return camera_.set(camera); }
  Status run(const YuvFrame& frame, std::uint8_t* out) const override {
    return lanes_.run(camera_, frame, out);
  }
  Status run(const PackedImage& image, std::uint8_t* out) const override {
    return lanes_.run(camera_, image, out);
  }

 private:
  WarpLanes& lanes_;
  const std::size_t table_bytes_;
  CameraTables camera_;
};

class CudaFrameWarper final : public geometry::FrameWarper {
 public:
  Status create(int gpu) { return lanes_.create(gpu); }
  Result<std::unique_ptr<geometry::FrameWarp>> make(const WarpCamera& camera) override {
    STGS_TRY(cuda_status(cudaSetDevice(lanes_.gpu()), "choosing the GPU"));
    const WarpBytes bytes = bytes_of(camera);
    if (!lanes_.memory().reserve(bytes)) {
      const double needed = static_cast<double>(bytes.tables + bytes.lane);
      return Status(
          StatusCode::kNoMemory,
          fmt::format("its frames of {}x{} pixels need {} of GPU memory, but frames get "
                      "only a quarter of the memory that was free",
                      camera.source_width, camera.source_height, cuda::bytes_text(needed)));
    }
    auto warp = std::make_unique<CudaFrameWarp>(lanes_, bytes.tables);
    STGS_TRY(warp->set(camera));
    return std::unique_ptr<geometry::FrameWarp>(std::move(warp));
  }

 private:
  WarpLanes lanes_;
};

}  // namespace

Result<std::unique_ptr<geometry::FrameWarper>> geometry::make_cuda_frame_warper(int gpu) {
  STGS_TRY(cuda::select_gpu(gpu).status());
  int device = 0;
  STGS_TRY(cuda_status(cudaGetDevice(&device), "choosing the GPU"));
  auto warper = std::make_unique<CudaFrameWarper>();
  STGS_TRY(warper->create(device));
  return std::unique_ptr<FrameWarper>(std::move(warper));
}

}  // namespace stgs::encoder
