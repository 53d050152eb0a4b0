// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/region_sweeper.h"

#include <algorithm>

#include "backend/cuda/kernels.h"

namespace stgs::encoder::cuda {

void RegionSweeper::clear() {
  regions_.clear();
  volume_ = pixels_ = 0;
  arrays_ = {};
}

void RegionSweeper::add(SweepRegion region) {
  const auto width = static_cast<std::size_t>(region.width);
  const auto height = static_cast<std::size_t>(region.height);
  const int tiles = blocks_of(width, kSweepTile) * blocks_of(height, kSweepTile);
  region.volume = volume_;
  region.pixels = pixels_;
  arrays_.max_width = std::max(arrays_.max_width, region.width);
  arrays_.max_height = std::max(arrays_.max_height, region.height);
  arrays_.max_planes = std::max(arrays_.max_planes, region.planes);
  arrays_.max_tiles = std::max(arrays_.max_tiles, tiles);
  arrays_.max_pixels = std::max(arrays_.max_pixels, width * height);
  pixels_ += width * height;
  volume_ += width * height * static_cast<std::size_t>(region.planes);
  regions_.push_back(region);
}

Status RegionSweeper::start(cudaStream_t stream) {
  STGS_TRY(device_regions_.set(regions_, stream));
  STGS_TRY(costs_.ensure(volume_));
  STGS_TRY(sums_.ensure(volume_));
  STGS_TRY(device_results_.ensure(pixels_));
  arrays_.regions = device_regions_.data();
  arrays_.count = static_cast<int>(regions_.size());
  arrays_.costs = costs_.data();
  arrays_.sums = sums_.data();
  arrays_.results = device_results_.data();
  return cuda_status(cudaMemsetAsync(sums_.data(), 0, volume_ * sizeof(std::uint16_t), stream),
                     "clearing a cost volume");
}

Status RegionSweeper::finish(const Stream& stream) {
  launch_sweep_costs(arrays_, stream);
  launch_sweep_paths(arrays_, stream);
  launch_sweep_depths(arrays_, stream);
  STGS_TRY(cuda_status(cudaGetLastError(), "starting a plane sweep"));
  results_.resize(pixels_);
  STGS_TRY(
      cuda_status(cudaMemcpyAsync(results_.data(), device_results_.data(),
                                  pixels_ * sizeof(RegionDepth), cudaMemcpyDeviceToHost, stream),
                  "reading depths"));
  return stream.wait();
}

}  // namespace stgs::encoder::cuda
