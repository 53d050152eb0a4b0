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
  active.push_back(static_cast<double>(stats.active));
  splats.push_back(static_cast<double>(stats.splats));
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

void StepTable::add(const player::RenderProfile& profile) {
  bytes_per_second_ = profile.bytes_per_second;
  operations_per_second_ = profile.operations_per_second;
  rows_.resize(profile.steps.size());
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const player::RenderStep& step = profile.steps[i];
    rows_[i].name = step.name;
    rows_[i].ms.push_back(step.ms);
    rows_[i].bytes.push_back(step.bytes);
    rows_[i].operations.push_back(step.operations);
  }
}

double StepTable::floor_ms(const Row& row) const {
  const double bytes = mean(row.bytes) / bytes_per_second_;
  if (operations_per_second_ == 0) return 1e3 * bytes;
  return 1e3 * std::max(bytes, mean(row.operations) / operations_per_second_);
}

Json StepTable::to_json() const {
  Json steps = Json::array();
  for (const Row& row : rows_) {
    steps.push_back({{"step", row.name},
                     {"ms", percentile(row.ms, 0.5)},
                     {"floor_ms", floor_ms(row)},
                     {"bytes", mean(row.bytes)},
                     {"operations", mean(row.operations)}});
  }
  return {{"bytes_per_second", bytes_per_second_},
          {"operations_per_second", operations_per_second_},
          {"steps", steps}};
}

std::string StepTable::to_text() const {
  std::string text = fmt::format("{:<12} {:>10} {:>10} {:>10} {:>10}\n", "step", "p50 ms",
                                 "floor ms", "MB", "10^9 ops");
  double ms = 0, floor = 0;
  for (const Row& row : rows_) {
    ms += percentile(row.ms, 0.5);
    floor += floor_ms(row);
    const bool counted = operations_per_second_ > 0;
    text += fmt::format("  {:<10} {:>10.4f} {:>10.4f} {:>10.2f} {:>10}\n", row.name,
                        percentile(row.ms, 0.5), floor_ms(row), 1e-6 * mean(row.bytes),
                        counted ? fmt::format("{:.3f}", 1e-9 * mean(row.operations)) : "-");
  }
  return text + fmt::format("  {:<10} {:>10.4f} {:>10.4f}\n", "all", ms, floor);
}

}  // namespace stgs::tools
