// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>
#include <vector>

#include "backend/cuda/hull_sweep.h"
#include "backend/cuda/kernels.h"
#include "backend/cuda/lane_pool.h"
#include "backend/cuda/memory.h"
#include "backend/cuda/region_sweeper.h"
#include "backend/cuda/select_gpu.h"
#include "backend/cuda/serial_gpu.h"
#include "backend/cuda/upload.h"
#include "geometry/hull_sweep.h"
#include "geometry/stereo_problem.h"
#include "geometry/sweep_mapping.h"

namespace stgs::encoder {
namespace {

using cuda::cuda_status;
using cuda::HullLimit;
using cuda::HullRay;
using cuda::HullSample;
using cuda::HullSpan;
using cuda::RegionDepth;
using cuda::SweepRegion;
using cuda::Uploaded;
using cuda::WaitAtEnd;
using geometry::HullBox;
using geometry::HullReference;
using geometry::HullSweep;
using geometry::kHullDepths;
using geometry::StereoSource;
using geometry::SweepCamera;

constexpr std::size_t kMaxLanes = 4;  // frames that are swept at a time

std::size_t area(int width, int height) {
  return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
}

geometry::Mat3 rotation_of(const SweepCamera& camera) {
  const auto r = [&](int i) { return static_cast<float>(camera.rotation[i]); };
  return {r(0), r(1), r(2), r(3), r(4), r(5), r(6), r(7), r(8)};
}

geometry::Vec3 translation_of(const SweepCamera& camera) {
  const auto t = [&](int i) { return static_cast<float>(camera.translation[i]); };
  return {t(0), t(1), t(2)};
}

// Returns a pinhole image without pixels.
geometry::StereoImage image_of(const SweepCamera& camera) {
  return {nullptr,
          nullptr,
          camera.width,
          camera.height,
          static_cast<float>(camera.fx),
          static_cast<float>(camera.fy),
          static_cast<float>(camera.cx),
          static_cast<float>(camera.cy)};
}

HullRay ray_of(const SweepCamera& from, const SweepCamera& to, const float* hiding) {
  const geometry::StereoImage image = image_of(to);
  // With a focal length of 1 and the centre at 0, positions are directions.
  StereoSource source{};
  source.image = {nullptr, nullptr, to.width, to.height, 1.0f, 1.0f, 0.0f, 0.0f};
  source = geometry::posed_source(source, rotation_of(from), translation_of(from), rotation_of(to),
                                  translation_of(to));
  source = geometry::derived_source(image_of(from), source);
  return {source.infinite, source.translation, hiding,   to.width, to.height,
          image.fx,        image.fy,           image.cx, image.cy};
}

// The memory and the stream of one frame.
class Lane {
 public:
  explicit Lane(int gpu) : gpu_(gpu) {}

  Status run(HullSweep& sweep) {
    // The device is a setting of the thread.
    STGS_TRY(cuda_status(cudaSetDevice(gpu_), "choosing the GPU"));
    STGS_TRY(stream_.create());
    const WaitAtEnd wait{stream_};
    return run_all(sweep);
  }

 private:
  Status run_all(HullSweep& sweep) {
    STGS_TRY(upload_views(sweep));
    STGS_TRY(upload_references(sweep));
    STGS_TRY(find_spans(sweep));
    make_regions(sweep);
    if (owners_.empty()) return {};
    STGS_TRY(sweep_regions());
    copy_results(sweep);
    return {};
  }

  Status upload_views(const HullSweep& sweep) {
    std::size_t total = 0;
    for (const auto& silhouette : sweep.silhouettes)
      total += area(silhouette.camera.width, silhouette.camera.height);
    STGS_TRY(hiding_.start(total));
    hiding_at_.assign(sweep.silhouettes.size(), nullptr);
    for (std::size_t v = 0; v < sweep.silhouettes.size(); ++v) {
      const auto& [camera, values] = sweep.silhouettes[v];
      STGS_TRY(hiding_.add(values, area(camera.width, camera.height), stream_, &hiding_at_[v]));
    }
    total = 0;
    for (const auto& image : sweep.images)
      if (image.corners != nullptr) total += area(image.camera.width, image.camera.height);
    STGS_TRY(corners_.start(total));
    images_.clear();
    for (const auto& [camera, values] : sweep.images) {
      const std::uint32_t* corners = nullptr;
      if (values != nullptr)
        STGS_TRY(corners_.add(values, area(camera.width, camera.height), stream_, &corners));
      images_.push_back({corners, nullptr, camera.width, camera.height});
    }
    return {};
  }

  Status upload_references(const HullSweep& sweep) {
    std::size_t total = 0;
    for (const HullReference& reference : sweep.references)
      total += area(images_[reference.image].width, images_[reference.image].height);
    STGS_TRY(masks_.start(total));
    mask_at_.assign(sweep.references.size(), nullptr);
    rays_.clear();
    for (std::size_t r = 0; r < sweep.references.size(); ++r) {
      const HullReference& reference = sweep.references[r];
      const SweepCamera& from = sweep.images[reference.image].camera;
      STGS_TRY(masks_.add(reference.mask, area(from.width, from.height), stream_, &mask_at_[r]));
      for (std::size_t v = 0; v < sweep.silhouettes.size(); ++v)
        rays_.push_back(ray_of(from, sweep.silhouettes[v].camera, hiding_at_[v]));
    }
    return device_rays_.set(rays_, stream_);
  }

  // Finds the sampled depths at which rays through each box meet the hull.
  Status find_spans(const HullSweep& sweep) {
    samples_.clear();
    spans_.clear();
    for (std::size_t r = 0; r < sweep.references.size(); ++r) {
      for (const HullBox& box : sweep.references[r].boxes) {
        add_samples(sweep, r, box);
        spans_.push_back({kHullDepths, -1});
      }
    }
    STGS_TRY(device_samples_.set(samples_, stream_));
    STGS_TRY(device_spans_.set(spans_, stream_));
    votes_ = {device_rays_.data(), static_cast<int>(sweep.silhouettes.size()),
              static_cast<float>(sweep.nearest)};
    cuda::launch_hull_spans(device_samples_.data(), static_cast<int>(samples_.size()), votes_,
                            static_cast<float>(1 / sweep.farthest),
                            static_cast<float>(span_step(sweep)), device_spans_.data(), stream_);
    STGS_TRY(cuda_status(cudaGetLastError(), "searching the visual hull"));
    STGS_TRY(cuda_status(
        cudaMemcpyAsync(spans_.data(), device_spans_.data(), spans_.size() * sizeof(HullSpan),
                        cudaMemcpyDeviceToHost, stream_),
        "reading the depths of the visual hull"));
    return stream_.wait();
  }

  void add_samples(const HullSweep& sweep, std::size_t r, const HullBox& box) {
    const HullReference& reference = sweep.references[r];
    const int width = images_[reference.image].width;
    const auto is_masked = [&](int x, int y) { return reference.mask[y * width + x] != 0; };
    int masked = 0;
    for (int y = box.y; y < box.y + box.height; ++y)
      for (int x = box.x; x < box.x + box.width; ++x) masked += is_masked(x, y) ? 1 : 0;
    const int stride = geometry::hull_stride(masked);
    for (int y = box.y + stride / 2; y < box.y + box.height; y += stride) {
      for (int x = box.x + stride / 2; x < box.x + box.width; x += stride) {
        if (!is_masked(x, y)) continue;
        samples_.push_back({static_cast<int>(spans_.size()),
                            static_cast<int>(r * sweep.silhouettes.size()),
                            static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f});
      }
    }
  }

  // The step in inverse depth between sampled depths.
  static double span_step(const HullSweep& sweep) {
    return (1 / sweep.nearest - 1 / sweep.farthest) / (kHullDepths - 1);
  }

  void make_regions(HullSweep& sweep) {
    sweeper_.clear();
    limits_.clear();
    owners_.clear();
    std::size_t span = 0;
    for (std::size_t r = 0; r < sweep.references.size(); ++r)
      for (const HullBox& box : sweep.references[r].boxes)
        add_region(sweep, r, box, spans_[span++]);
  }

  void add_region(HullSweep& sweep, std::size_t r, const HullBox& box, HullSpan span) {
    if (span.last < span.first) return;  // no ray meets the hull
    // One sample larger on each side.
    const auto inverse = [&](int k) {
      return 1 / sweep.farthest + std::clamp(k, 0, kHullDepths - 1) * span_step(sweep);
    };
    const double near = inverse(span.last + 1), far = inverse(span.first - 1);
    HullReference& reference = sweep.references[r];
    SweepRegion region{};
    region.planes = sweep.planes(static_cast<int>(r), 1 / near, 1 / far);
    const double step = (near - far) / (region.planes - 1);
    reference.step = std::max(reference.step, step);
    region.farthest_inverse = far;
    region.step = step;
    region.reference = images_[reference.image];
    const SweepCamera& from = sweep.images[reference.image].camera;
    for (const int j : reference.sources) {
      region.sources[region.source_count++] = {
          images_[j], geometry::sweep_mapping(from, sweep.images[j].camera, box.x, box.y)};
    }
    region.x = box.x;
    region.y = box.y;
    region.width = box.width;
    region.height = box.height;
    sweeper_.add(region);
    limits_.push_back({mask_at_[r], static_cast<int>(r * sweep.silhouettes.size())});
    owners_.push_back(r);
  }

  Status sweep_regions() {
    STGS_TRY(sweeper_.start(stream_));
    STGS_TRY(device_limits_.set(limits_, stream_));
    cuda::launch_hull_limits(sweeper_.arrays(), device_limits_.data(), votes_, stream_);
    return sweeper_.finish(stream_);
  }

  void copy_results(HullSweep& sweep) const {
    for (std::size_t k = 0; k < owners_.size(); ++k) {
      const SweepRegion& region = sweeper_.regions()[k];
      const HullReference& reference = sweep.references[owners_[k]];
      const RegionDepth* from = sweeper_.results(region);
      for (int y = region.y; y < region.y + region.height; ++y) {
        for (int x = region.x; x < region.x + region.width; ++x, ++from) {
          reference.depth[y * region.reference.width + x] = from->depth;
          reference.cost[y * region.reference.width + x] = from->cost;
        }
      }
    }
  }

  cuda::Stream stream_;
  Uploaded<float> hiding_{"silhouettes"};
  Uploaded<std::uint32_t> corners_{"images of dynamic content"};
  Uploaded<std::uint8_t> masks_{"motion masks"};
  Uploaded<HullRay> device_rays_{"rays to silhouettes"};
  Uploaded<HullSample> device_samples_{"pixels of dynamic content"};
  Uploaded<HullSpan> device_spans_{"depths of the visual hull"};
  Uploaded<HullLimit> device_limits_{"limits of plane sweeps"};
  cuda::RegionSweeper sweeper_;
  const int gpu_;
  std::vector<const float*> hiding_at_;        // per silhouette, on the device
  std::vector<geometry::SweepSource> images_;  // on the device
  std::vector<const std::uint8_t*> mask_at_;   // per reference, on the device
  std::vector<HullRay> rays_;
  std::vector<HullSample> samples_;
  std::vector<HullSpan> spans_;      // per box
  std::vector<HullLimit> limits_;    // of each region
  std::vector<std::size_t> owners_;  // the reference of each region
  cuda::HullVotes votes_{};
};

class CudaHullSweeper final : public geometry::HullSweeper {
 public:
  explicit CudaHullSweeper(int gpu) : lanes_(gpu, kMaxLanes) {}
  Status run(HullSweep& sweep) override { return cuda::with_remedy(lanes_.take()->run(sweep)); }

 private:
  cuda::LanePool<Lane> lanes_;
};

}  // namespace

Result<std::unique_ptr<geometry::HullSweeper>> geometry::make_cuda_hull_sweeper(int gpu) {
  STGS_TRY(cuda::select_gpu(gpu).status());
  int device = 0;
  STGS_TRY(cuda_status(cudaGetDevice(&device), "choosing the GPU"));
  return std::unique_ptr<HullSweeper>(std::make_unique<CudaHullSweeper>(device));
}

}  // namespace stgs::encoder
