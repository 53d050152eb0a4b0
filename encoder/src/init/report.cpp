// SPDX-License-Identifier: Apache-2.0
#include "init/report.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/imgproc.hpp>

#include "plural.h"
#include "stgs/encoder/report_page.h"
#include "train/rig.h"

namespace stgs::encoder::init {
namespace {

// A page section with the images of one camera.
struct Section {
  std::string title;
  std::vector<std::pair<std::string, std::string>> images;  // file, caption
};

cv::Scalar rgb_of(const InitialPoint& point) {
  return {double(point.colour[0]), double(point.colour[1]), double(point.colour[2])};
}

// Draws the points of a frame back to front, as squares of their colour.
cv::Mat draw_points(const View& view, const std::vector<InitialPoint>& points, cv::Mat canvas,
                    int frame, int half) {
  std::vector<std::pair<double, std::size_t>> order;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (points[i].frame != frame) continue;
    const Pixel p = project(view, position_of(points[i]));
    if (p.inside) order.emplace_back(-p.depth, i);
  }
  std::sort(order.begin(), order.end());
  for (const auto& [depth, i] : order) {
    const Pixel p = project(view, position_of(points[i]));
    cv::rectangle(canvas, cv::Point(p.x() - half, p.y() - half),
                  cv::Point(p.x() + half, p.y() + half), rgb_of(points[i]), cv::FILLED);
  }
  return canvas;
}

void draw_velocities(const View& view, const std::vector<InitialPoint>& points, int frame,
                     cv::Mat* canvas) {
  int n = 0;
  for (const InitialPoint& point : points) {
    if (point.frame != frame || n++ % 6 != 0) continue;
    const cv::Vec3d from = position_of(point);
    const cv::Vec3d to =
        from + 4.0 * cv::Vec3d(point.velocity[0], point.velocity[1], point.velocity[2]);
    const Pixel a = project(view, from), b = project(view, to);
    if (!a.inside || b.depth <= 0 || std::hypot(b.u - a.u, b.v - a.v) > view.width) continue;
    cv::arrowedLine(*canvas, {a.x(), a.y()}, {int(b.u), int(b.v)}, {255, 255, 0}, 1, cv::LINE_AA, 0,
                    0.3);
  }
}

cv::Mat overlay(const cv::Mat& image, const cv::Mat& mask) {
  cv::Mat out = image.clone();
  if (mask.empty()) return out;
  cv::Mat red(image.size(), CV_8UC3, cv::Scalar(255, 40, 40)), mixed;
  cv::addWeighted(image, 0.45, red, 0.55, 0, mixed);
  mixed.copyTo(out, mask);
  std::vector<std::vector<cv::Point>> contours;
  cv::findContours(mask.clone(), contours, cv::RETR_LIST, cv::CHAIN_APPROX_NONE);
  cv::drawContours(out, contours, -1, {255, 255, 255}, 1);
  return out;
}

// Returns inverse depth as colours, darkened where it was interpolated rather than measured.
cv::Mat depth_image(const Surface& surface, DepthRange range) {
  cv::Mat level(surface.depth.size(), CV_8U), colours;
  for (int y = 0; y < level.rows; ++y) {
    for (int x = 0; x < level.cols; ++x) {
      const double inverse = 1 / std::max(1e-9, double(surface.depth.at<float>(y, x)));
      const double share =
          (inverse - 1 / range.farthest) / (1 / range.nearest - 1 / range.farthest);
      level.at<std::uint8_t>(y, x) = std::uint8_t(std::clamp(255 * share, 0.0, 255.0));
    }
  }
  cv::applyColorMap(level, colours, cv::COLORMAP_TURBO);
  cv::cvtColor(colours, colours, cv::COLOR_BGR2RGB);
  cv::Mat dark = colours * 0.35;
  dark.copyTo(colours, surface.weight <= 0);
  return colours;
}

// Returns the cameras as seen from above: along the mean of their downward axes.
std::vector<MapCamera> map_of(const PreparedCapture& capture) {
  cv::Vec3d down(0, 0, 0);
  for (const Camera& camera : capture.cameras)
    down += cv::Vec3d(camera.rotation[3], camera.rotation[4], camera.rotation[5]);
  down = cv::norm(down) > 1e-6 ? cv::normalize(down) : cv::Vec3d(0, 1, 0);
  const cv::Vec3d any = std::abs(down[0]) < 0.9 ? cv::Vec3d(1, 0, 0) : cv::Vec3d(0, 0, 1);
  const cv::Vec3d right = cv::normalize(any - down * down.dot(any)), below = down.cross(right);
  std::vector<MapCamera> cameras;
  for (const Camera& camera : capture.cameras) {
    const RigPose pose = rig_pose(camera);
    const cv::Vec3d centre(pose.centre), view(pose.forward);
    cameras.push_back({camera.name, right.dot(centre), below.dot(centre), right.dot(view),
                       below.dot(view), camera.test});
  }
  return cameras;
}

void add_verdict(const std::vector<Finding>& findings, ReportPage* page) {
  if (findings.empty()) {
    page->paragraph("No problems found: ready to train.");
    return;
  }
  page->heading("Findings");
  std::vector<std::pair<std::string, std::string>> rows;
  for (const Finding& finding : findings) rows.emplace_back(finding.text, finding.remedy);
  page->table(rows);
}

ReportPage page_of(const PreparedCapture& capture, const ReportFacts& facts,
                   const std::vector<Section>& sections) {
  ReportPage page("Prepared capture");
  page.paragraph(fmt::format("{}, {}, layout {}.", plural(capture.cameras.size(), "camera"),
                             plural(capture.frames, "frame"), capture.source));
  add_verdict(facts.findings, &page);
  page.heading("Capture");
  page.table(facts.lines);
  page.map("Cameras from above (rings: held out)", map_of(capture));
  page.heading("Time");
  std::vector<std::pair<std::string, std::string>> seconds;
  for (const StageTime& stage : facts.stages) {
    seconds.emplace_back(stage.name, fmt::format("{:.1f} s", stage.seconds));
  }
  page.table(seconds);
  for (const Section& section : sections) {
    page.heading(section.title);
    for (const auto& [file, caption] : section.images) page.image(file, caption);
  }
  return page;
}

// Writes the images of view i.
Status write_section(const ReportContents& contents, int i, const std::string& folder,
                     Section* section) {
  const PreparedCapture& capture = contents.capture;
  const View& view = contents.views[i];
  const std::string& name = view.camera->name;
  section->title = fmt::format("Camera {}", name);
  const auto add = [&](const std::string& kind, const std::string& caption,
                       const cv::Mat& image) -> Status {
    const std::string file = fmt::format("{}_{}.png", name, kind);
    section->images.emplace_back(file, caption);
    return write_png(fmt::format("{}/{}", folder, file), image);
  };
  if (i < int(contents.motion.size()) && !contents.motion[i].background.empty()) {
    STGS_TRY(add("background", "median background", contents.motion[i].background));
  }
  const std::vector<Surface>& surfaces = contents.scene.surfaces;
  const auto surface = std::find_if(surfaces.begin(), surfaces.end(), [&](const Surface& one) {
    return one.view.camera == view.camera;
  });
  if (surface != surfaces.end()) {
    STGS_TRY(add("depth",
                 "background depth (red: near, blue: far; darkened: interpolated, not measured)",
                 depth_image(*surface, contents.scene.range)));
  }
  cv::Mat canvas(view.size(), CV_8UC3, cv::Scalar::all(0));
  canvas = draw_points(view, contents.static_points, canvas, -1, 1);
  STGS_TRY(add("static", "static points", canvas));
  std::vector<int> frames{0, capture.frames / 2};
  if (frames[1] == 0) frames.pop_back();
  for (const int frame : frames) {
    STGS_ASSIGN(const cv::Mat image, load_image(capture, view, frame));
    STGS_ASSIGN(const cv::Mat mask, load_mask_image(capture, view, frame));
    STGS_TRY(add(fmt::format("mask_{:06}", frame), fmt::format("dynamic content, frame {}", frame),
                 overlay(image, mask)));
    cv::Mat dim = image * 0.3;
    dim = draw_points(view, contents.dynamic_points, dim, frame, 1);
    draw_velocities(view, contents.dynamic_points, frame, &dim);
    STGS_TRY(add(fmt::format("dynamic_{:06}", frame),
                 fmt::format("dynamic points and their motion over 4 frames, frame {}", frame),
                 dim));
  }
  return {};
}

}  // namespace

Status write_report(const ReportContents& contents, const ReportFacts& facts, Work& work) {
  const std::string folder = contents.capture.folder + "/report";
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return io_error("{}: cannot create the folder: {}", folder, error.message());
  const std::vector<int> chosen = spread(contents.views, 4);
  std::vector<Section> sections(chosen.size());
  STGS_TRY(work.for_each(int(chosen.size()), [&](int k) {
    return write_section(contents, chosen[k], folder, &sections[k]);
  }));
  return page_of(contents.capture, facts, sections).write(folder);
}

}  // namespace stgs::encoder::init
