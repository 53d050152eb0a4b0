// SPDX-License-Identifier: Apache-2.0
// Checks shared by the tests of the CUDA training backend.
#pragma once

#include <cmath>
#include <vector>

#include "backend/cuda/cuda_backend.h"
#include "catch.h"
#include "fixtures/synthetic_capture.h"
#include "fixtures/train_run.h"
#include "stgs/encoder/train.h"

namespace stgs::testing {

inline constexpr const char* kAttributeNames[encoder::kAttributes] = {
    "position", "log_scale", "rotation",  "opacity", "sh",
    "time",     "velocity",  "log_sigma", "radius"};

// |a - b| / |a| in double precision (|a - b| if a is 0); infinite if it is not finite.
template <typename Array>
double difference(const Array& a, const Array& b) {
  if (a.size() != b.size()) return INFINITY;
  double square = 0, length = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = static_cast<double>(a[i]) - static_cast<double>(b[i]);
    square += d * d;
    length += static_cast<double>(a[i]) * a[i];
  }
  const double relative = length > 0 ? std::sqrt(square / length) : std::sqrt(square);
  return std::isfinite(relative) ? relative : INFINITY;
}

// The backend of all test cases, so that each also runs after the others.
inline encoder::cuda::CudaBackend& cuda_backend() {
  static encoder::cuda::CudaBackend backend;
  static const Status status = backend.create();
  REQUIRE(status.ok());
  return backend;
}

inline void check(const Status& status) {
  INFO(status.message());
  REQUIRE(status.ok());
}

// Densifies two equal states, one on the CPU and one on the GPU, checks that the decisions are
// identical and returns their counts.
inline encoder::DensifyCounts densify_both(encoder::TrainState& cpu, encoder::TrainState& gpu,
                                           const encoder::DensifyInput& input) {
  const auto reference = encoder::make_cpu_backend();
  check(reference->begin(cpu));
  const Result<encoder::DensifyCounts> expected = reference->densify(input);
  check(expected.status());
  check(cuda_backend().begin(gpu));
  const Result<encoder::DensifyCounts> found = cuda_backend().densify(input);
  check(found.status());
  check(cuda_backend().synchronise());
  CHECK(found->non_finite == expected->non_finite);
  CHECK(found->cloned == expected->cloned);
  CHECK(found->split == expected->split);
  CHECK(found->removed == expected->removed);
  CHECK(found->replaced == expected->replaced);
  CHECK(expected->cloned + expected->split + expected->replaced > 100);
  REQUIRE(gpu.size() == cpu.size());
  CHECK(cuda_backend().size() == cpu.size());
  CHECK(gpu.updates == cpu.updates);
  CHECK(gpu.statistics.views == cpu.statistics.views);
  CHECK(gpu.statistics.error_max == cpu.statistics.error_max);
  return *expected;
}

// Trains to a held-out PSNR above `min_psnr` (dB). Then trains again, stops at iteration 235 and
// resumes; the result has the same bits.
inline void check_resumes(const test::SyntheticCapture& synthetic, encoder::TrainSettings settings,
                          double min_psnr) {
  const Result<Scene> uninterrupted =
      encoder::train(synthetic.capture, settings, nullptr, nullptr, nullptr);
  check(uninterrupted.status());
  CHECK(test::held_out_psnr(synthetic, *uninterrupted) > min_psnr);
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  settings.checkpoint_interval = 235;
  int stops = 0;
  const auto stop = [&](const encoder::Progress& progress) {
    const bool at_stop = progress.stage == "train" && progress.detail.find("iteration 235,") == 0;
    stops += at_stop;
    return !at_stop;
  };
  CHECK_FALSE(encoder::train(synthetic.capture, settings, stop, nullptr, nullptr).ok());
  CHECK(stops == 1);
  settings.resume = settings.checkpoint;
  const Result<Scene> resumed =
      encoder::train(synthetic.capture, settings, nullptr, nullptr, nullptr);
  check(resumed.status());
  CHECK(test::same(resumed->gaussians, uninterrupted->gaussians));
}

}  // namespace stgs::testing
