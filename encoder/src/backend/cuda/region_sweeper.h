// SPDX-License-Identifier: Apache-2.0
// Sweeps regions on a GPU: the memory of the host and of the device around region_sweep.h.
#pragma once

#include <vector>

#include "backend/cuda/region_sweep.h"
#include "backend/cuda/upload.h"

namespace stgs::encoder::cuda {

class RegionSweeper {
 public:
  // Removes all regions.
  void clear();
  // Adds a region, of which it sets `volume` and `pixels`.
  void add(SweepRegion region);
  const std::vector<SweepRegion>& regions() const { return regions_; }
  std::size_t volume() const { return volume_; }  // entries of all regions

  // Allocates the volume and uploads the regions. Afterwards, the caller sets the costs of
  // arrays(): 0 where a plane is possible, otherwise kImpossible.
  Status start(cudaStream_t stream);
  const SweepRegions& arrays() const { return arrays_; }
  // Computes the results, and waits for them.
  Status finish(const Stream& stream);
  // The depths of a region, row by row.
  const RegionDepth* results(const SweepRegion& region) const {
    return results_.data() + region.pixels;
  }

 private:
  std::vector<SweepRegion> regions_;
  std::size_t volume_ = 0, pixels_ = 0;  // entries
  SweepRegions arrays_{};
  Uploaded<SweepRegion> device_regions_{"regions of plane sweeps"};
  DeviceArray<std::uint8_t> costs_;
  DeviceArray<std::uint16_t> sums_;
  DeviceArray<RegionDepth> device_results_;
  std::vector<RegionDepth> results_;
};

}  // namespace stgs::encoder::cuda
