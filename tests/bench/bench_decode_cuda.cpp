// SPDX-License-Identifier: Apache-2.0
// Prints the speed of the CUDA segment decoder, from bytes that a reader has verified to arrays of
// floats, as JSON lines.
//
// usage: bench_decode_cuda FILE COPIES...
// Each COPIES is a number of copies of all segments that are decoded at once, and gives one line.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>

#include "device_gaussians.h"
#include "stgs/format/scene_file.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

using Clock = std::chrono::steady_clock;
constexpr int kRuns = 15;

double milliseconds_since(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

void check(const Status& status) {
  if (!status.ok()) throw std::runtime_error(status.message());
}

void measure(const SceneReader& reader, int copies) {
  const Clock::time_point begin = Clock::now();
  std::vector<CodedSegment> coded;
  for (std::uint32_t s = 0; s < reader.segments().size(); ++s) {
    Result<CodedSegment> segment = reader.read(s, true);
    check(segment.status());
    coded.push_back(std::move(*segment));
  }
  const double read_ms = milliseconds_since(begin);
  std::vector<DeviceGaussianArrays> sets;
  std::vector<const CodedSegment*> segments;
  std::vector<player::cuda::DeviceGaussians> views;
  std::size_t primitives = 0;
  for (int copy = 0; copy < copies; ++copy) {
    for (const CodedSegment& segment : coded) {
      sets.emplace_back(segment.primitives, segment.sh_degree);
      segments.push_back(&segment);
      views.push_back(sets.back().view());
      primitives += segment.primitives;
    }
  }
  player::cuda::SegmentDecoder decoder;
  check(decoder.set_tables(reader.tables(), nullptr));
  cudaEvent_t first = nullptr, last = nullptr;
  check_cuda(cudaEventCreate(&first));
  check_cuda(cudaEventCreate(&last));
  double best = 1e30, best_device = 1e30;
  for (int run = 0; run < kRuns; ++run) {
    const Clock::time_point start = Clock::now();
    check(decoder.prepare(segments, views));
    check_cuda(cudaEventRecord(first, nullptr));
    check(decoder.launch(nullptr));
    check_cuda(cudaEventRecord(last, nullptr));
    const Result<std::vector<bool>> intact = decoder.finish();
    check(intact.status());
    best = std::min(best, milliseconds_since(start));
    if (std::find(intact->begin(), intact->end(), false) != intact->end()) {
      throw std::runtime_error("a segment cannot be decoded");
    }
    float device = 0;
    check_cuda(cudaEventElapsedTime(&device, first, last));
    best_device = std::min(best_device, static_cast<double>(device));
  }
  const auto speed = [&](double ms) { return static_cast<double>(primitives) / ms * 1e-3; };
  std::printf(
      "{\"segments\": %zu, \"primitives\": %zu, \"read_ms\": %.2f, \"ms\": %.3f, "
      "\"mprimitives_per_s\": %.0f, \"device_ms\": %.3f, \"device_mprimitives_per_s\": %.0f}\n",
      segments.size(), primitives, read_ms, best, speed(best), best_device, speed(best_device));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: bench_decode_cuda FILE COPIES...\n");
    return 1;
  }
  try {
    const auto reader = SceneReader::open(std::string(argv[1]));
    check(reader.status());
    for (int k = 2; k < argc; ++k) measure(**reader, std::atoi(argv[k]));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 4;
  }
  return 0;
}
