// SPDX-License-Identifier: Apache-2.0
// A page for a person to look at: HTML of its own, without scripts, its charts inline SVG, its
// pictures files beside it. The reports of preparing and of training are such pages.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "stgs/format/scene_statistics.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Text as HTML shows it.
std::string escape_html(const std::string& text);

struct ChartSeries {
  std::string name;
  std::vector<std::pair<double, double>> points;  // x ascending; what is not finite is left out
};

struct Chart {
  std::string title, x_label;
  std::vector<ChartSeries> series;
};

struct BarChart {
  std::string title;
  std::vector<std::pair<std::string, double>> bars;  // label, value >= 0
};

// Everything given as text is escaped.
class ReportPage {
 public:
  explicit ReportPage(const std::string& title);

  void heading(const std::string& text);
  void paragraph(const std::string& text);
  // As typed: a command line.
  void code(const std::string& text);
  void table(const std::vector<std::pair<std::string, std::string>>& rows);
  // A picture in the page's folder; a row of them ends at the next heading.
  void image(const std::string& file, const std::string& caption);
  // Nothing where no series has two points.
  void chart(const Chart& chart);
  void bars(const BarChart& chart);

  // Writes index.html into a folder that exists.
  Status write(const std::string& folder) const;

 private:
  std::string html_;
};

// "0.5 to 1" labels with their counts; empty bins at both ends are left out.
std::vector<std::pair<std::string, double>> histogram_bars(const std::vector<HistogramBin>& bins);

}  // namespace stgs::encoder
