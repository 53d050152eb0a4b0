// SPDX-License-Identifier: Apache-2.0
// What drawing pictures took, and how it is told.
#pragma once

#include <string>
#include <vector>

#include "session.h"
#include "stgs/player/renderer.h"

namespace stgs::tools {

// Of some pictures.
struct Pass {
  std::vector<double> frame, fetch, slice, bin, blend, device;  // milliseconds a picture
  std::vector<double> alive, drawn;                             // primitives, splats of all views
  std::size_t stored = 0;                                       // primitives, at most

  void add(double frame_ms, const player::RenderStats& stats);
};

// The least value that the share of all values does not exceed; not of nothing.
double percentile(std::vector<double> values, double share);
double sum(const std::vector<double>& values);
double mean(const std::vector<double>& values);

Json to_json(const Pass& pass);
// A table with `name` at its head.
std::string to_text(const char* name, const Pass& pass);

// What each step of drawing takes, beside its floor: the longer of its bytes over the device's
// bandwidth and its operations over their rate.
class StepTable {
 public:
  // One picture's, which all have the same steps.
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
