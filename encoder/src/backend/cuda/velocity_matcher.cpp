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

// Of the pairs that are matched at a time. A point takes 125 bytes.
constexpr std::size_t kMaxPoints = std::size_t{1} << 21, kMaxPairs = 4096;

// Runs one problem at a time.
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
    for (std::size_t first = 0; first < problem.pairs.size();) {
      const std::size_t end = make_batch(problem, first);
      if (arrays_.points > 0) STGS_TRY(run_batch());
      take_steps(problem, first, end);
      first = end;
    }
    return {};
  }

  Status upload_frames(const VelocityProblem& problem) {
    points_.clear();
    frame_at_.clear();
    for (const std::vector<MatchPoint>& frame : problem.frames) {
      frame_at_.push_back(points_.size());
      points_.insert(points_.end(), frame.begin(), frame.end());
    }
    return device_points_.set(points_, stream_);
  }

  // Lists the pairs from `first` on that are matched together, and returns their end.
  std::size_t make_batch(const VelocityProblem& problem, std::size_t first) {
    pairs_.clear();
    arrays_ = {};
    arrays_.reach = static_cast<float>(problem.reach);
    std::size_t end = first;
    for (; end < problem.pairs.size() && end - first < kMaxPairs; ++end) {
      const FramePair& pair = problem.pairs[end];
      const std::size_t from = problem.frames[pair.from].size(),
                        to = problem.frames[pair.to].size();
      if (end > first && arrays_.points + from > kMaxPoints) break;
      pairs_.push_back({device_points_.data() + frame_at_[pair.from],
                        device_points_.data() + frame_at_[pair.to], static_cast<int>(from),
                        static_cast<int>(to), arrays_.points});
      arrays_.points += from;
      arrays_.most_points = std::max(arrays_.most_points, from);
    }
    arrays_.count = static_cast<int>(pairs_.size());
    return end;
  }

  Status run_batch() {
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

  void take_steps(VelocityProblem& problem, std::size_t first, std::size_t end) const {
    for (std::size_t k = first; k < end; ++k) {
      const cuda::MatchedClouds& pair = pairs_[k - first];
      const auto from = steps_.begin() + static_cast<std::ptrdiff_t>(pair.first);
      problem.pairs[k].steps.assign(from, from + pair.from_count);
    }
  }

  cuda::SerialGpu gpu_;
  const cuda::Stream& stream_ = gpu_.stream();
  cuda::Uploaded<MatchPoint> device_points_;
  cuda::Uploaded<cuda::MatchedClouds> device_pairs_;
  DeviceArray<std::uint32_t> neighbours_;
  DeviceArray<std::uint8_t> neighbour_counts_;
  DeviceArray<Vec3> matched_, device_steps_;
  cuda::VelocityArrays arrays_{};
  std::vector<MatchPoint> points_;
  std::vector<std::size_t> frame_at_;  // first point of each frame
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
