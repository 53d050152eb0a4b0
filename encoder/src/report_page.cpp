// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/report_page.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "stgs/format/escape.h"
#include "stgs/format/output_file.h"

namespace stgs::encoder {
namespace {

constexpr double kWidth = 460, kHeight = 260;                          // chart size, pixels
constexpr double kLeft = 62, kRight = 12, kTop = 28, kBottom = 40;     // margins, pixels
constexpr const char* kColours[] = {"#1f6fb4", "#d1611c", "#3a8f3a"};  // cycle of series colours

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  void add(double v) {
    low = std::min(low, v);
    high = std::max(high, v);
  }
};

// Returns a step of 1, 2 or 5 times a power of ten that divides the range into about five.
double tick_step(const Range& range) {
  const double rough = (range.high - range.low) / 5;
  const double decade = std::pow(10.0, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * decade >= rough) return factor * decade;
  }
  return 10 * decade;
}

struct Axes {
  Range x, y;
  double px(double v) const {
    return kLeft + (v - x.low) / (x.high - x.low) * (kWidth - kLeft - kRight);
  }
  double py(double v) const {
    return kHeight - kBottom - (v - y.low) / (y.high - y.low) * (kHeight - kTop - kBottom);
  }
};

bool finite(const std::pair<double, double>& point) {
  return std::isfinite(point.first) && std::isfinite(point.second);
}

// Sets the axes to the non-empty ranges of all finite points. Returns false if no series has two
// points or no point is finite.
bool fit(const Chart& chart, Axes& axes) {
  bool line = false;
  for (const ChartSeries& series : chart.series) {
    line = line || series.points.size() > 1;
    for (const auto& point : series.points) {
      if (!finite(point)) continue;
      axes.x.add(point.first);
      axes.y.add(point.second);
    }
  }
  for (Range* range : {&axes.x, &axes.y}) {
    if (!(range->low <= range->high)) return false;
    const double slack = std::max(1e-9, 1e-3 * std::abs(range->low));
    if (range->high - range->low < slack) {
      range->low -= slack;
      range->high += slack;
    }
  }
  return line;
}

// Returns the index of the first multiple of `step` in a range.
int first_tick(const Range& range, double step) {
  return static_cast<int>(std::ceil(range.low / step));
}

std::string ticks(const Axes& axes) {
  std::string svg;
  const double bottom = kHeight - kBottom, step_x = tick_step(axes.x), step_y = tick_step(axes.y);
  for (int i = first_tick(axes.x, step_x); i * step_x <= axes.x.high; ++i) {
    const double v = i * step_x;
    svg += fmt::format(
        "<line x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1}\" y2=\"{2}\" class=\"grid\"/>"
        "<text x=\"{0:.1f}\" y=\"{3}\" text-anchor=\"middle\">{4:.6g}</text>\n",
        axes.px(v), kTop, bottom, bottom + 15, v);
  }
  for (int i = first_tick(axes.y, step_y); i * step_y <= axes.y.high; ++i) {
    const double v = i * step_y;
    svg += fmt::format(
        "<line x1=\"{0}\" x2=\"{1}\" y1=\"{2:.1f}\" y2=\"{2:.1f}\" class=\"grid\"/>"
        "<text x=\"{3}\" y=\"{4:.1f}\" text-anchor=\"end\">{5:.6g}</text>\n",
        kLeft, kWidth - kRight, axes.py(v), kLeft - 5, axes.py(v) + 4, v);
  }
  return svg;
}

std::string open_svg(const std::string& title, double height) {
  return fmt::format(
      "<svg width=\"{0}\" height=\"{1}\" viewBox=\"0 0 {0} {1}\" role=\"img\">"
      "<title>{2}</title><text x=\"{3}\" y=\"16\" class=\"title\">{2}</text>\n",
      kWidth, height, escape_html(title), kLeft);
}

}  // namespace

ReportPage::ReportPage(const std::string& title)
    : html_(fmt::format(
          "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{0}</title>\n"
          "<style>body{{font-family:sans-serif;margin:2em}}table{{border-collapse:collapse}}"
          "td{{padding:.2em 1em .2em 0;vertical-align:top}}"
          "figure{{display:inline-block;margin:.5em}}"
          "img{{max-width:480px;image-rendering:pixelated}}"
          "svg{{margin:.5em;font-size:11px}}.grid{{stroke:#ddd}}.title{{font-size:13px}}"
          "pre{{background:#f4f4f4;padding:.6em;white-space:pre-wrap}}</style>\n<h1>{0}</h1>\n",
          escape_html(title))) {}

void ReportPage::heading(const std::string& text) {
  html_ += fmt::format("<h2>{}</h2>\n", escape_html(text));
}

void ReportPage::paragraph(const std::string& text) {
  html_ += fmt::format("<p>{}</p>\n", escape_html(text));
}

void ReportPage::code(const std::string& text) {
  html_ += fmt::format("<pre>{}</pre>\n", escape_html(text));
}

void ReportPage::table(const std::vector<std::pair<std::string, std::string>>& rows) {
  html_ += "<table>\n";
  for (const auto& [name, value] : rows) {
    html_ +=
        fmt::format("<tr><td>{}</td><td>{}</td></tr>\n", escape_html(name), escape_html(value));
  }
  html_ += "</table>\n";
}

void ReportPage::image(const std::string& file, const std::string& caption) {
  html_ += fmt::format(
      "<figure><a href=\"{0}\"><img src=\"{0}\" alt=\"{1}\"></a><figcaption>{1}</figcaption>"
      "</figure>\n",
      escape_url(file, "._-"), escape_html(caption));
}

void ReportPage::video(const std::string& file, const std::string& caption) {
  html_ += fmt::format(
      "<figure><video src=\"{0}\" controls autoplay loop muted playsinline></video><figcaption>{1}"
      "</figcaption></figure>\n",
      escape_url(file, "._-"), escape_html(caption));
}

void ReportPage::chart(const Chart& chart) {
  Axes axes;
  if (!fit(chart, axes)) return;
  html_ += open_svg(chart.title, kHeight) + ticks(axes);
  for (std::size_t i = 0; i < chart.series.size(); ++i) {
    const char* colour = kColours[i % std::size(kColours)];
    std::string points;
    for (const auto& point : chart.series[i].points) {
      if (!finite(point)) continue;
      points += fmt::format("{:.1f},{:.1f} ", axes.px(point.first), axes.py(point.second));
    }
    html_ +=
        fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.5\"/>\n",
                    points, colour);
    if (chart.series.size() > 1) {
      html_ += fmt::format("<text x=\"{}\" y=\"{}\" text-anchor=\"end\" fill=\"{}\">{}</text>\n",
                           kWidth - kRight, kHeight - kBottom - 8 - 14 * static_cast<double>(i),
                           colour, escape_html(chart.series[i].name));
    }
  }
  html_ += fmt::format("<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text></svg>\n",
                       (kLeft + kWidth - kRight) / 2, kHeight - 8, escape_html(chart.x_label));
}

void ReportPage::bars(const BarChart& chart) {
  constexpr double kRow = 17, kLabel = 130, kValue = 60;
  double largest = 0;
  for (const auto& [label, value] : chart.bars) largest = std::max(largest, value);
  if (largest <= 0) return;
  html_ += open_svg(chart.title, kTop + kRow * static_cast<double>(chart.bars.size()));
  double y = kTop;
  for (const auto& [label, value] : chart.bars) {
    const double width = value / largest * (kWidth - kLabel - kValue);
    html_ += fmt::format(
        "<text x=\"{}\" y=\"{:.1f}\" text-anchor=\"end\">{}</text>"
        "<rect x=\"{}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{}\" fill=\"{}\"/>"
        "<text x=\"{:.1f}\" y=\"{:.1f}\">{:.6g}</text>\n",
        kLabel - 6, y + 12, escape_html(label), kLabel, y + 2, width, kRow - 4, kColours[0],
        kLabel + width + 5, y + 12, value);
    y += kRow;
  }
  html_ += "</svg>\n";
}

void ReportPage::map(const std::string& title, const std::vector<MapCamera>& cameras) {
  constexpr double kSize = 360, kMargin = 40, kArrow = 26, kDot = 5, kLabelX = 30, kLabelY = 16;
  if (cameras.empty()) return;
  Range x, y;
  for (const MapCamera& camera : cameras) {
    x.add(camera.x);
    y.add(camera.y);
  }
  const double extent = std::max({x.high - x.low, y.high - y.low, 1e-9});
  const double scale = (kSize - 2 * kMargin) / extent;
  const double left = (kWidth - scale * (x.high - x.low)) / 2, top = kTop + kMargin;
  html_ += open_svg(title, kTop + 2 * kMargin + scale * (y.high - y.low));
  for (const MapCamera& camera : cameras) {
    const double px = left + scale * (camera.x - x.low), py = top + scale * (camera.y - y.low);
    const double length = std::max(1e-9, std::hypot(camera.dx, camera.dy));
    const double ux = camera.dx / length, uy = camera.dy / length;
    html_ += fmt::format(
        "<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"{}\"/>"
        "<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{}\" stroke=\"{}\" fill=\"{}\"/>"
        "<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"middle\">{}</text>\n",
        px, py, px + kArrow * ux, py + kArrow * uy, kColours[0], px, py, kDot, kColours[0],
        camera.hollow ? "white" : kColours[0], px - kLabelX * ux, py - kLabelY * uy + 4,
        escape_html(camera.name));
  }
  html_ += "</svg>\n";
}

Status ReportPage::write(const std::string& folder) const {
  return write_file_atomically(folder + "/index.html",
                               {reinterpret_cast<const std::uint8_t*>(html_.data()), html_.size()});
}

std::vector<std::pair<std::string, double>> histogram_bars(const std::vector<HistogramBin>& bins) {
  const auto occupied = [](const HistogramBin& bin) { return bin.count > 0; };
  const auto first = std::find_if(bins.begin(), bins.end(), occupied);
  const auto last = std::find_if(bins.rbegin(), bins.rend(), occupied).base();
  std::vector<std::pair<std::string, double>> bars;
  for (auto bin = first; bin < last; ++bin) {
    bars.emplace_back(std::isfinite(bin->to) ? fmt::format("{:.3g} to {:.3g}", bin->from, bin->to)
                                             : fmt::format("over {:.3g}", bin->from),
                      static_cast<double>(bin->count));
  }
  return bars;
}

}  // namespace stgs::encoder
