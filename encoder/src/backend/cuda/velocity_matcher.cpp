// SPDX-License-Identifier: Apache-2.0
#include "geometry/velocity_matcher.h"

#include <algorithm>
#include <utility>

#include "backend/cuda/serial_gpu.h"
#include "backend/cuda/upload.h"
#include "backend/cuda/velocity.h"

namespace stgs::encoder {
namespace {

using cuda::cuda_status;
using cuda::DeviceArray;
using geometry::FramePair;
using geometry::MatchPoint;
using geometry::VelocityProblem;
using math::Vec3;

class CudaVelocityMatcher final : public geometry::VelocityMatcher {
 public:
  Status create(int gpu) { return gpu_.create(gpu); }
  std::string name() const override { return gpu_.name(); }

  Status run(VelocityProblem& problem) override {
    return gpu_.run([&] { return run_all(problem); });
  }

 private:
  Status run_all(VelocityProblem& problem) {
    STGS_TRY(upload_frames(problem));
    list_pairs(problem);
    if (arrays_.points == 0) return {};
    STGS_TRY(match_pairs());
    for (std::size_t k = 0; k < pairs_.size(); ++k) {
      const Vec3* const from = steps_.data() + pairs_[k].first;
      problem.pairs[k].steps.assign(from, from + pairs_[k].from_count);
    }
    return {};
  }

  Status upload_frames(const VelocityProblem& problem) {
    std::size_t total = 0;
    for (const std::vector<MatchPoint>& frame : problem.frames) total += frame.size();
    STGS_TRY(points_.start(total));
    frames_.clear();
    for (const std::vector<MatchPoint>& frame : problem.frames)
      STGS_TRY(points_.add(frame.data(), frame.size(), stream_, &frames_.emplace_back()));
    return {};
  }

  void list_pairs(const VelocityProblem& problem) {
    pairs_.clear();
    arrays_ = {};
    arrays_.reach = static_cast<float>(problem.reach);
    for (const FramePair& pair : problem.pairs) {
      const std::size_t from = problem.frames[pair.from].size();
      pairs_.push_back({frames_[pair.from], frames_[pair.to], static_cast<int>(from),
                        static_cast<int>(problem.frames[pair.to].size()), arrays_.points});
      arrays_.points += from;
      arrays_.max_points = std::max(arrays_.max_points, from);
    }
    arrays_.count = static_cast<int>(pairs_.size());
  }

  Status match_pairs() {
    STGS_TRY(device_pairs_.set(pairs_, stream_));
    STGS_TRY(neighbours_.ensure(arrays_.points * geometry::kWideNeighbours));
    STGS_TRY(neighbour_counts_.ensure(arrays_.points));
    STGS_TRY(matched_.ensure(arrays_.points));
    STGS_TRY(device_steps_.ensure(arrays_.points));
    arrays_.pairs = device_pairs_.data();
    arrays_.neighbours = neighbours_.data();
    arrays_.neighbour_counts = neighbour_counts_.data();
    arrays_.matched = matched_.data();
    arrays_.steps = device_steps_.data();
    cuda::launch_velocity_neighbours(arrays_, stream_);
    for (int round = 0; round < geometry::kMatchRounds; ++round)
      cuda::launch_velocity_round(arrays_, round, stream_);
    STGS_TRY(cuda_status(cudaGetLastError(), "matching the points of frames"));
    steps_.resize(arrays_.points);
    STGS_TRY(
        cuda_status(cudaMemcpyAsync(steps_.data(), device_steps_.data(),
                                    arrays_.points * sizeof(Vec3), cudaMemcpyDeviceToHost, stream_),
                    "reading velocities"));
    return stream_.wait();
  }

  cuda::SerialGpu gpu_;
  const cuda::Stream& stream_ = gpu_.stream();
  cuda::Uploaded<MatchPoint> points_{"dynamic points"};
  cuda::Uploaded<cuda::MatchedClouds> device_pairs_{"pairs of frames"};
  DeviceArray<std::uint32_t> neighbours_;
  DeviceArray<std::uint8_t> neighbour_counts_;
  DeviceArray<Vec3> matched_, device_steps_;
  cuda::VelocityArrays arrays_{};
  std::vector<const MatchPoint*> frames_;  // on the device
  std::vector<cuda::MatchedClouds> pairs_;
  std::vector<Vec3> steps_;
};

}  // namespace

Result<std::unique_ptr<geometry::VelocityMatcher>> geometry::make_cuda_velocity_matcher(int gpu) {
  auto matcher = std::make_unique<CudaVelocityMatcher>();
  STGS_TRY(matcher->create(gpu));
  return std::unique_ptr<VelocityMatcher>(std::move(matcher));
}

}  // namespace stgs::encoder
