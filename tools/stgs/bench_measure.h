// SPDX-License-Identifier: Apache-2.0
// Timings of rendering, and their reports.
#pragma once

#include <string>
#include <vector>

#include "session.h"
#include "stgs/player/renderer.h"

namespace stgs::tools {

// The timings of a series of frames. Each vector has one entry per frame.
struct Pass {
  std::vector<double> frame, fetch, slice, bin, blend, device;  // milliseconds
  std::vector<double> active;                                   // active primitives
  std::vector<double> splats;                                   // splats of all views
  std::size_t stored = 0;  // maximum number of resident primitives

  void add(double frame_ms, const player::RenderStats& stats);
};

// Returns the smallest value that is not exceeded by the fraction `share` of all values. `values`
// must not be empty.
double percentile(std::vector<double> values, double share);
double sum(const std::vector<double>& values);
// `values` must not be empty.
double mean(const std::vector<double>& values);

Json to_json(const Pass& pass);
// Returns a table with `name` in its header.
std::string to_text(const char* name, const Pass& pass);

// The duration of each rendering step next to its lower bound: the larger of bytes / memory
// bandwidth and operations / operation rate.
class StepTable {
 public:
  // Adds the profile of one frame. All frames must have the same steps.
  void add(const player::RenderProfile& profile);
  Json to_json() const;
  std::string to_text() const;

 private:
  struct Row {
    std::string name;
    std::vector<double> ms, bytes, operations;
  };
  double floor_ms(const Row& row) const;

  double bytes_per_second_ = 0, operations_per_second_ = 0;
  std::vector<Row> rows_;
};

}  // namespace stgs::tools
