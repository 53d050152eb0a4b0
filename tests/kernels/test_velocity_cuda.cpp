// SPDX-License-Identifier: Apache-2.0
// Compares velocities from nearest neighbours on CUDA with the CPU, and prints the time of both.
// Exit code 77: no device.
#include <chrono>
#include <thread>

#include "backend/cuda/upload.h"
#include "catch_runner.h"
#include "encoder/velocity_scene.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

std::unique_ptr<geometry::VelocityMatcher> on_gpu() {
  auto matcher = geometry::make_cuda_velocity_matcher(0);
  INFO(matcher.status().message());
  REQUIRE(matcher.ok());
  CHECK((*matcher)->name().substr(0, 6) == "cuda (");
  return std::move(*matcher);
}

// Returns the share of velocities that differ (velocity_scene.h).
double share_different(const std::vector<Velocities>& a, const std::vector<Velocities>& b) {
  std::size_t count = 0, wrong = 0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    REQUIRE(a[k].size() == b[k].size());
    count += a[k].size();
    wrong += different(a[k], b[k]);
  }
  REQUIRE(count > 0);
  return double(wrong) / double(count);
}

template <typename Task>
double milliseconds(const Task& task) {
  const auto start = std::chrono::steady_clock::now();
  task();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

void print_times(const char* what, const std::vector<DynamicFrame>& frames,
                 geometry::VelocityMatcher& gpu) {
  matched(frames, 1, &gpu);
  const double cpu_time = milliseconds([&] { matched(frames, 1, nullptr); });
  const double gpu_time = milliseconds([&] { matched(frames, 1, &gpu); });
  std::printf("%s: CPU %.1f ms, CUDA %.2f ms\n", what, cpu_time, gpu_time);
}

}  // namespace

TEST_CASE("velocities on CUDA match the CPU") {
  const auto gpu = on_gpu();
  const std::vector<DynamicFrame> frames =
      ellipsoids({1, 2, 0, 24, 26, 128, 129, 127, 2304, 2300, 5000, 4999});
  for (const int interval : {1, 2, 11}) {
    const auto found = matched(frames, interval, gpu.get());
    INFO("interval " << interval);
    // Rounding decides between neighbours at nearly equal distances.
    CHECK(share_different(matched(frames, interval, nullptr), found) < 0.001);
  }
}

TEST_CASE("velocities on CUDA of frames without points are empty") {
  const auto gpu = on_gpu();
  for (const Velocities& velocities : matched(ellipsoids({0, 0}), 1, gpu.get()))
    CHECK(velocities.empty());
  CHECK(matched(ellipsoids({3}), 1, gpu.get())[0] == Velocities(3, cv::Vec3d(0, 0, 0)));
}

TEST_CASE("several problems and several threads have equal velocities") {
  const auto gpu = on_gpu();
  // More pairs than a problem has.
  std::vector<int> counts(5000, 40);
  const std::vector<DynamicFrame> frames = ellipsoids(counts);
  CHECK(share_different(matched(frames, 1, nullptr), matched(frames, 1, gpu.get())) < 0.001);
  const std::vector<DynamicFrame> few = ellipsoids({300, 310, 290});
  const std::vector<Velocities> alone = matched(few, 1, gpu.get());
  constexpr std::size_t kThreads = 4;
  std::vector<std::vector<Velocities>> together(kThreads);
  std::vector<Status> statuses(kThreads);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < kThreads; ++i)
    threads.emplace_back([&, i] { statuses[i] = match(few, 1, gpu.get(), &together[i]); });
  for (std::thread& thread : threads) thread.join();
  for (std::size_t i = 0; i < kThreads; ++i) {
    CHECK(statuses[i].ok());
    CHECK(together[i] == alone);
  }
}

TEST_CASE("an upload that does not fit names its values and its size") {
  cuda::Uploaded<geometry::MatchPoint> points("dynamic points");
  const std::string message = points.start(std::size_t{1} << 40).message();
  CHECK(message.substr(0, 62) == "dynamic points: out of GPU memory (allocating 24576.0 GiB); fr");
  CHECK(points.start(1000).ok());
}

TEST_CASE("the largest frames of a problem have the velocities of the CPU") {
  const auto gpu = on_gpu();
  const std::vector<DynamicFrame> frames = ellipsoids({100000, 100000});
  std::vector<Velocities> found, expected;
  const double gpu_time = milliseconds([&] { found = matched(frames, 1, gpu.get()); });
  const double cpu_time = milliseconds([&] { expected = matched(frames, 1, nullptr); });
  CHECK(share_different(expected, found) < 0.001);
  std::printf("2 frames of 100000 points: CPU %.0f ms, CUDA %.0f ms\n", cpu_time, gpu_time);
}

TEST_CASE("times of velocities") {
  const auto gpu = on_gpu();
  print_times("60 frames of 2304 points", ellipsoids(std::vector<int>(60, 2304)), *gpu);
  print_times("a live window of 4 frames of 5000 points", ellipsoids(std::vector<int>(4, 5000)),
              *gpu);
}
