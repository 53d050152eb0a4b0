// SPDX-License-Identifier: Apache-2.0
// Prints the time of multi-view stereo on one CPU thread and on CUDA, for four views of 96x72.
// usage: bench_stereo    Exit code 0; 1: stereo failed; 77: no device, and only the CPU's time.
#include <algorithm>
#include <chrono>
#include <cstdio>

#include "stereo_scene.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

constexpr int kRepeats = 5;

// Returns the shortest time in seconds; 0 on an error.
double shortest(const std::vector<StereoView>& views, ViewMatcher& matcher) {
  double best = 1e9;
  for (int k = 0; k < kRepeats; ++k) {
    const auto begin = std::chrono::steady_clock::now();
    if (matched(views, matcher).empty()) return 0;
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
    best = std::min(best, taken.count());
  }
  return best;
}

}  // namespace

int main() {
  const std::vector<StereoView> views = rig();
  const double on_cpu = shortest(views, *make_cpu_matcher());
  std::printf("cpu, one thread: %.4f s\n", on_cpu);
  const auto cuda = make_cuda_matcher(0);
  if (!cuda.ok()) {
    std::printf("cuda: %s\n", cuda.status().message().c_str());
    return 77;
  }
  const double on_cuda = shortest(views, **cuda);
  std::printf("%s: %.4f s\n", (*cuda)->name().c_str(), on_cuda);
  return on_cpu > 0 && on_cuda > 0 ? 0 : 1;
}
