// SPDX-License-Identifier: Apache-2.0
#include "bench_measure.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace stgs::tools {
namespace {

Json to_json(const std::vector<double>& values) {
  return {{"mean", mean(values)},
          {"p50", percentile(values, 0.5)},
          {"p95", percentile(values, 0.95)},
          {"p99", percentile(values, 0.99)}};
}

}  // namespace

void Pass::add(double frame_ms, const player::RenderStats& stats) {
  frame.push_back(frame_ms);
  fetch.push_back(stats.fetch_ms);
  slice.push_back(stats.slice_ms);
  bin.push_back(stats.bin_ms);
  blend.push_back(stats.blend_ms);
  device.push_back(stats.device_ms);
  alive.push_back(static_cast<double>(stats.alive));
  drawn.push_back(static_cast<double>(stats.drawn));
  stored = std::max(stored, stats.stored);
}

double percentile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  const double rank = std::ceil(share * static_cast<double>(values.size()));
  return values[static_cast<std::size_t>(std::max(rank, 1.0)) - 1];
}

double sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

double mean(const std::vector<double>& values) {
  return sum(values) / static_cast<double>(values.size());
}

Json to_json(const Pass& pass) {
  return {{"fps", 1e3 / percentile(pass.frame, 0.5)},
          {"frame_ms", to_json(pass.frame)},
          {"fetch_ms", to_json(pass.fetch)},
          {"slice_ms", to_json(pass.slice)},
          {"bin_ms", to_json(pass.bin)},
          {"blend_ms", to_json(pass.blend)},
          {"device_ms", to_json(pass.device)}};
}

std::string to_text(const char* name, const Pass& pass) {
  std::string text =
      fmt::format("{:<8} {:>10} {:>10} {:>10} {:>10}\n", name, "mean ms", "p50", "p95", "p99");
  const auto row = [&text](const char* stage, const std::vector<double>& values) {
    text +=
        fmt::format("  {:<6} {:>10.3f} {:>10.3f} {:>10.3f} {:>10.3f}\n", stage, mean(values),
                    percentile(values, 0.5), percentile(values, 0.95), percentile(values, 0.99));
  };
  row("frame", pass.frame);
  row("fetch", pass.fetch);
  row("slice", pass.slice);
  row("bin", pass.bin);
  row("blend", pass.blend);
  if (percentile(pass.device, 1) > 0) row("device", pass.device);
  return text;
}

}  // namespace stgs::tools
