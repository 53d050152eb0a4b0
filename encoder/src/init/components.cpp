// SPDX-License-Identifier: Apache-2.0
#include "init/components.h"

#include <algorithm>
#include <cstddef>
#include <cstring>

namespace stgs::encoder::init {
namespace {

// Returns the first column from `x` on that has `value`; `width` if there is none.
int find_column(const std::uint8_t* row, int x, int width, std::uint8_t value) {
  const void* const found = std::memchr(row + x, value, static_cast<std::size_t>(width - x));
  return found == nullptr ? width : static_cast<int>(static_cast<const std::uint8_t*>(found) - row);
}

// Appends the runs of a row. The component of a run is its number.
void append_runs(const cv::Mat& mask, int y, std::uint8_t value, std::vector<Run>& runs) {
  const std::uint8_t* const row = mask.ptr(y);
  const auto other = static_cast<std::uint8_t>(~value);
  for (int last = 0;;) {
    const int first = find_column(row, last, mask.cols, value);
    if (first == mask.cols) return;
    last = find_column(row, first, mask.cols, other);
    runs.push_back({y, first, last, static_cast<int>(runs.size())});
  }
}

// The first run of the component of a run. Shortens the path to it.
int root_of(std::vector<Run>& runs, int run) {
  while (runs[run].component != run) {
    runs[run].component = runs[runs[run].component].component;
    run = runs[run].component;
  }
  return run;
}

void join(std::vector<Run>& runs, int a, int b) {
  a = root_of(runs, a);
  b = root_of(runs, b);
  runs[std::max(a, b)].component = std::min(a, b);
}

// Joins the runs [middle, end) of a row with those of the row above, [begin, middle).
void join_rows(std::vector<Run>& runs, int begin, int middle, int reach) {
  int above = begin;
  for (int run = middle; run < static_cast<int>(runs.size()); ++run) {
    while (above < middle && runs[above].last + reach <= runs[run].first) ++above;
    for (int k = above; k < middle && runs[k].first < runs[run].last + reach; ++k)
      join(runs, k, run);
  }
}

}  // namespace

Components find_components(const cv::Mat& mask, std::uint8_t value, bool diagonal) {
  Components out;
  std::vector<Run>& runs = out.runs;
  for (int y = 0, begin = 0; y < mask.rows; ++y) {
    const int middle = static_cast<int>(runs.size());
    append_runs(mask, y, value, runs);
    join_rows(runs, begin, middle, diagonal ? 1 : 0);
    begin = middle;
  }
  // Numbers the components. The component of a run before this one has its number already.
  for (int run = 0; run < static_cast<int>(runs.size()); ++run) {
    Run& one = runs[run];
    const bool is_first = one.component == run;
    one.component =
        is_first ? static_cast<int>(out.components.size()) : runs[one.component].component;
    if (is_first) out.components.emplace_back();
    Component& component = out.components[one.component];
    component.area += one.last - one.first;
    component.at_border = component.at_border || one.y == 0 || one.y == mask.rows - 1 ||
                          one.first == 0 || one.last == mask.cols;
  }
  return out;
}

}  // namespace stgs::encoder::init
