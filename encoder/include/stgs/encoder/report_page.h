// SPDX-License-Identifier: Apache-2.0
// Builds the HTML reports of preparing and training: one page without scripts, with inline SVG
// charts and with images from files next to it.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "stgs/format/scene_statistics.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct ChartSeries {
  std::string name;
  std::vector<std::pair<double, double>> points;  // x ascending; non-finite points are skipped
};

struct Chart {
  std::string title, x_label;
  std::vector<ChartSeries> series;
};

struct BarChart {
  std::string title;
  std::vector<std::pair<std::string, double>> bars;  // label, value >= 0
};

// A camera on a map of a rig, in any unit: position and direction of view.
struct MapCamera {
  std::string name;
  double x = 0, y = 0, dx = 0, dy = 0;
  bool hollow = false;  // drawn as a ring
};

// Collects the page in memory; write() stores it. All text is escaped. Not thread-safe.
class ReportPage {
 public:
  // Starts a page with this title, which is also its first heading.
  explicit ReportPage(const std::string& title);

  // Adds a second-level heading.
  void heading(const std::string& text);
  // Adds a paragraph.
  void paragraph(const std::string& text);
  // Adds preformatted text such as a command line.
  void code(const std::string& text);
  // Adds a table of (name, value) rows.
  void table(const std::vector<std::pair<std::string, std::string>>& rows);
  // Adds an image file from the folder of the page, as a link to it. Consecutive images form a row.
  void image(const std::string& file, const std::string& caption);
  // Adds a video file from the folder of the page, silent and in a loop.
  void video(const std::string& file, const std::string& caption);
  // Adds a line chart. Adds nothing if no series has two points.
  void chart(const Chart& chart);
  // Adds a horizontal bar chart. Adds nothing if every value is 0.
  void bars(const BarChart& chart);
  // Adds a map of cameras, with equal scales along both axes; y points down. Adds nothing without
  // cameras.
  void map(const std::string& title, const std::vector<MapCamera>& cameras);

  // Writes index.html atomically into an existing folder.
  Status write(const std::string& folder) const;

 private:
  std::string html_;
};

// Converts histogram bins to bars labelled "0.5 to 1". Empty bins at both ends are dropped.
std::vector<std::pair<std::string, double>> histogram_bars(const std::vector<HistogramBin>& bins);

}  // namespace stgs::encoder
