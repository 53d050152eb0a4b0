// SPDX-License-Identifier: Apache-2.0
#include "geometry/view_sweeper.h"

#include <utility>

#include "backend/cuda/region_sweeper.h"
#include "backend/cuda/serial_gpu.h"

namespace stgs::encoder {
namespace {

using cuda::cuda_status;
using cuda::SweepRegion;
using geometry::SweepSource;
using geometry::ViewSweep;
using geometry::ViewSweeps;

std::size_t pixels_of(const SweepSource& image) {
  return static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
}

class CudaViewSweeper final : public geometry::ViewSweeper {
 public:
  Status create(int gpu) { return gpu_.create(gpu); }
  std::string name() const override { return gpu_.name(); }

  Status run(const ViewSweeps& problem) override {
    return gpu_.run([&] { return run_all(problem); });
  }

 private:
  Status run_all(const ViewSweeps& problem) {
    STGS_TRY(upload_images(problem));
    sweeper_.clear();
    for (const ViewSweep& sweep : problem.sweeps) sweeper_.add(region_of(sweep));
    STGS_TRY(sweep_regions());
    for (std::size_t k = 0; k < problem.sweeps.size(); ++k)
      take_depths(problem.sweeps[k], sweeper_.regions()[k]);
    return {};
  }

  Status upload_images(const ViewSweeps& problem) {
    std::size_t total = 0, with_usable = 0;
    for (const SweepSource& image : problem.images) {
      total += pixels_of(image);
      if (image.usable != nullptr) with_usable += pixels_of(image);
    }
    STGS_TRY(corners_.start(total));
    STGS_TRY(usable_.start(with_usable));
    images_.clear();
    for (SweepSource image : problem.images) {
      const std::size_t pixels = pixels_of(image);
      STGS_TRY(corners_.add(image.corners, pixels, stream_, &image.corners));
      if (image.usable != nullptr)
        STGS_TRY(usable_.add(image.usable, pixels, stream_, &image.usable));
      images_.push_back(image);
    }
    return {};
  }

  SweepRegion region_of(const ViewSweep& sweep) const {
    SweepRegion region{};
    region.reference = images_[sweep.reference];
    for (const geometry::SweptSource& source : sweep.sources)
      region.sources[region.source_count++] = {images_[source.image], source.mapping};
    region.width = region.reference.width;
    region.height = region.reference.height;
    region.planes = sweep.planes;
    region.farthest_inverse = 1 / sweep.farthest;
    region.step = (1 / sweep.nearest - 1 / sweep.farthest) / (sweep.planes - 1);
    return region;
  }

  Status sweep_regions() {
    STGS_TRY(sweeper_.start(stream_));
    STGS_TRY(cuda_status(cudaMemsetAsync(sweeper_.arrays().costs, 0, sweeper_.volume(), stream_),
                         "clearing a cost volume"));
    return sweeper_.finish(stream_);
  }

  void take_depths(const ViewSweep& sweep, const SweepRegion& region) const {
    const cuda::RegionDepth* from = sweeper_.results(region);
    for (std::size_t i = 0; i < pixels_of(region.reference); ++i) {
      sweep.depth[i] = from[i].depth;
      sweep.cost[i] = from[i].cost;
    }
  }

  cuda::SerialGpu gpu_;
  const cuda::Stream& stream_ = gpu_.stream();
  cuda::Uploaded<std::uint32_t> corners_{"images of static content"};
  cuda::Uploaded<std::uint32_t> usable_{"masks of static content"};
  cuda::RegionSweeper sweeper_;
  std::vector<SweepSource> images_;  // on the device
};

}  // namespace

Result<std::unique_ptr<geometry::ViewSweeper>> geometry::make_cuda_view_sweeper(int gpu) {
  auto sweeper = std::make_unique<CudaViewSweeper>();
  STGS_TRY(sweeper->create(gpu));
  return std::unique_ptr<ViewSweeper>(std::move(sweeper));
}

}  // namespace stgs::encoder
