// SPDX-License-Identifier: Apache-2.0
#include "init/motion.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "stgs/encoder/frame_memory.h"

namespace stgs::encoder::init {
namespace {

constexpr int kBackgroundSamples = 25;
// Largest forward-backward error of reliable flow, pixels, plus 5 % of its length.
constexpr double kRoundTrip = 0.75;

struct Background {
  cv::Mat colour, valid;  // 8-bit RGB; 8-bit 0 or 255
  double noise = 1;       // standard deviation of a static pixel, grey levels
};

// Returns the median of each channel over the samples whose mask is 0 (an empty mask is 0
// everywhere). The noise is the median over pixels of the median absolute deviation of green.
Background median_of(const std::vector<cv::Mat>& samples, const std::vector<cv::Mat>& masks) {
  const cv::Size size = samples[0].size();
  Background out{cv::Mat(size, CV_8UC3, cv::Scalar::all(0)), cv::Mat(size, CV_8U, cv::Scalar(0)),
                 1};
  std::vector<int> histogram(256, 0);
  std::uint8_t values[3][kBackgroundSamples];
  long counted = 0;
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      int n = 0;
      for (std::size_t s = 0; s < samples.size(); ++s) {
        if (!masks[s].empty() && masks[s].at<std::uint8_t>(y, x)) continue;
        const cv::Vec3b c = samples[s].at<cv::Vec3b>(y, x);
        for (int k = 0; k < 3; ++k) values[k][n] = c[k];
        ++n;
      }
      if (n == 0) continue;
      cv::Vec3b& colour = out.colour.at<cv::Vec3b>(y, x);
      for (int k = 0; k < 3; ++k) {
        std::nth_element(values[k], values[k] + n / 2, values[k] + n);
        colour[k] = values[k][n / 2];
      }
      out.valid.at<std::uint8_t>(y, x) = 255;
      for (int i = 0; i < n; ++i) values[1][i] = std::uint8_t(std::abs(values[1][i] - colour[1]));
      std::nth_element(values[1], values[1] + n / 2, values[1] + n);
      ++histogram[values[1][n / 2]];
      ++counted;
    }
  }
  long below = 0;
  for (int level = 0; level < 256 && counted > 0; ++level) {
    // Interpolates within the level.
    if (2 * (below + histogram[level]) >= counted) {
      const double inside = (0.5 * double(counted) - double(below)) / histogram[level];
      out.noise = std::clamp(1.4826 * (level - 0.5 + inside), 0.7, 12.0);
      break;
    }
    below += histogram[level];
  }
  return out;
}

// Returns the largest channel difference after a light blur, 8-bit.
cv::Mat difference(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat blurred_a, blurred_b, d;
  cv::blur(a, blurred_a, {3, 3});
  cv::blur(b, blurred_b, {3, 3});
  cv::absdiff(blurred_a, blurred_b, d);
  cv::Mat channels[3];
  cv::split(d, channels);
  return cv::max(cv::max(channels[0], channels[1]), channels[2]);
}

// Returns the per-pixel threshold of a change. It allows for noise, and for misregistration at
// edges.
cv::Mat change_threshold(const cv::Mat& background, double noise) {
  cv::Mat grey, dx, dy, slope;
  cv::cvtColor(background, grey, cv::COLOR_RGB2GRAY);
  cv::blur(grey, grey, {3, 3});
  cv::Sobel(grey, dx, CV_32F, 1, 0, 3, 1.0 / 8);
  cv::Sobel(grey, dy, CV_32F, 0, 1, 3, 1.0 / 8);
  cv::magnitude(dx, dy, slope);
  cv::dilate(slope, slope, cv::Mat());
  return cv::Mat(6.0 + 3.0 * noise + 0.15 * slope);
}

// Returns the components of `weak` with at least `smallest` pixels that contain a pixel of
// `strong`.
cv::Mat hysteresis(const cv::Mat& weak, const cv::Mat& strong, int smallest) {
  cv::Mat labels, stats, centroids;
  const int n = cv::connectedComponentsWithStats(weak, labels, stats, centroids, 8, CV_32S);
  std::vector<std::uint8_t> keep(n, 0);
  for (int y = 0; y < weak.rows; ++y) {
    const int* label = labels.ptr<int>(y);
    const std::uint8_t* seed = strong.ptr(y);
    for (int x = 0; x < weak.cols; ++x) {
      if (seed[x] && label[x] > 0) keep[label[x]] = 255;
    }
  }
  for (int i = 1; i < n; ++i) {
    if (stats.at<int>(i, cv::CC_STAT_AREA) < smallest) keep[i] = 0;
  }
  cv::Mat out(weak.size(), CV_8U);
  for (int y = 0; y < weak.rows; ++y) {
    for (int x = 0; x < weak.cols; ++x) {
      out.at<std::uint8_t>(y, x) = keep[labels.at<int>(y, x)];
    }
  }
  return out;
}

// Fills small holes, because the uniform interior of a moving object shows no change.
void fill_holes(cv::Mat* mask) {
  cv::Mat labels, stats, centroids;
  const int n = cv::connectedComponentsWithStats(~*mask, labels, stats, centroids, 4, CV_32S);
  const int largest = int(mask->total() / 120);
  for (int i = 1; i < n; ++i) {
    const cv::Rect box(stats.at<int>(i, cv::CC_STAT_LEFT), stats.at<int>(i, cv::CC_STAT_TOP),
                       stats.at<int>(i, cv::CC_STAT_WIDTH), stats.at<int>(i, cv::CC_STAT_HEIGHT));
    const bool at_border =
        box.x == 0 || box.y == 0 || box.br().x == mask->cols || box.br().y == mask->rows;
    if (at_border || stats.at<int>(i, cv::CC_STAT_AREA) > largest) continue;
    (*mask)(box).setTo(255, labels(box) == i);
  }
}

cv::Mat clean(const cv::Mat& weak, const cv::Mat& strong) {
  const int smallest = std::max(8, int(weak.total() / 12000));
  cv::Mat mask = hysteresis(weak, strong, smallest);
  cv::morphologyEx(mask, mask, cv::MORPH_CLOSE,
                   cv::getStructuringElement(cv::MORPH_ELLIPSE, {5, 5}));
  fill_holes(&mask);
  cv::morphologyEx(mask, mask, cv::MORPH_OPEN, cv::getStructuringElement(cv::MORPH_CROSS, {3, 3}));
  mask = hysteresis(mask, strong, smallest);
  cv::dilate(mask, mask, cv::getStructuringElement(cv::MORPH_CROSS, {3, 3}));
  return mask;
}

cv::Mat grey_of(const cv::Mat& rgb) {
  cv::Mat grey;
  cv::cvtColor(rgb, grey, cv::COLOR_RGB2GRAY);
  return grey;
}

cv::Mat not_a_number(cv::Size size) {
  return cv::Mat(size, CV_32FC2, cv::Scalar::all(std::numeric_limits<double>::quiet_NaN()));
}

// Returns the dense flow from a to b, NaN where the backward flow disagrees. All NaN for images too
// small for DIS.
cv::Mat checked_flow(cv::DISOpticalFlow& dis, const cv::Mat& a, const cv::Mat& b) {
  if (a.cols < 32 || a.rows < 32) return not_a_number(a.size());
  cv::Mat forward, back;
  dis.calc(a, b, forward);
  dis.calc(b, a, back);
  for (int y = 0; y < a.rows; ++y) {
    for (int x = 0; x < a.cols; ++x) {
      cv::Vec2f& f = forward.at<cv::Vec2f>(y, x);
      const int tx = x + int(std::lround(f[0])), ty = y + int(std::lround(f[1]));
      bool good = tx >= 0 && ty >= 0 && tx < a.cols && ty < a.rows;
      if (good) {
        const cv::Vec2f r = back.at<cv::Vec2f>(ty, tx);
        good = std::hypot(f[0] + r[0], f[1] + r[1]) < kRoundTrip + 0.05 * std::hypot(f[0], f[1]);
      }
      if (!good) f = cv::Vec2f::all(std::numeric_limits<float>::quiet_NaN());
    }
  }
  return forward;
}

// Returns 255 where the flow is known and clearly longer than that of static pixels.
cv::Mat moving_by_flow(const cv::Mat& flow) {
  cv::Mat mask(flow.size(), CV_8U, cv::Scalar(0));
  std::vector<float> lengths;
  for (int y = 0; y < flow.rows; y += 2) {
    for (int x = 0; x < flow.cols; x += 2) {
      const auto& f = flow.at<cv::Vec2f>(y, x);
      if (f[0] == f[0]) lengths.push_back(std::hypot(f[0], f[1]));
    }
  }
  if (lengths.empty()) return mask;
  std::nth_element(lengths.begin(), lengths.begin() + lengths.size() / 2, lengths.end());
  const float threshold = std::clamp(5 * lengths[lengths.size() / 2], 0.4f, 1.0f);
  for (int y = 0; y < flow.rows; ++y) {
    for (int x = 0; x < flow.cols; ++x) {
      const auto& f = flow.at<cv::Vec2f>(y, x);
      if (std::hypot(f[0], f[1]) > threshold) mask.at<std::uint8_t>(y, x) = 255;
    }
  }
  return mask;
}

FlowPatch pack_flow(const cv::Mat& flow, const cv::Mat& mask) {
  FlowPatch patch;
  patch.step = 2;
  std::vector<cv::Point> points;
  if (flow.empty() || cv::countNonZero(mask) == 0) return patch;
  const cv::Rect full = cv::boundingRect(mask);
  patch.box = {full.x / 2, full.y / 2, (full.width + 1) / 2, (full.height + 1) / 2};
  patch.vectors = cv::Mat(patch.box.size(), CV_16SC2, cv::Scalar::all(FlowPatch::kNoFlow));
  for (int y = 0; y < patch.box.height; ++y) {
    for (int x = 0; x < patch.box.width; ++x) {
      const int px = std::min(2 * (patch.box.x + x), flow.cols - 1);
      const int py = std::min(2 * (patch.box.y + y), flow.rows - 1);
      const cv::Vec2f f = flow.at<cv::Vec2f>(py, px);
      if (!mask.at<std::uint8_t>(py, px) || !(std::abs(f[0]) < 1000 && std::abs(f[1]) < 1000)) {
        continue;
      }
      patch.vectors.at<cv::Vec2s>(y, x) = {short(std::lround(f[0] / FlowPatch::kUnit)),
                                           short(std::lround(f[1] / FlowPatch::kUnit))};
    }
  }
  return patch;
}

// Returns the given flow at the size of the view. Empty if the camera has none.
Result<cv::Mat> given_flow(const PreparedCapture& capture, const View& view,
                           const InitSettings& settings, int frame) {
  if (settings.flow_folder.empty()) return cv::Mat();
  const CaptureFolder& files = *settings.flow_files;
  STGS_ASSIGN(const std::string path, find_flow(files, settings.flow_folder, view.camera->name,
                                                capture.first_frame + frame));
  if (path.empty()) return cv::Mat();
  STGS_ASSIGN(cv::Mat flow, read_flow(files, path));
  const double sx = double(view.width) / flow.cols, sy = double(view.height) / flow.rows;
  cv::resize(flow, flow, view.size(), 0, 0, cv::INTER_NEAREST);
  cv::multiply(flow, cv::Scalar(sx, sy), flow);
  return flow;
}

Status write_mask(const PreparedCapture& capture, const View& view, int frame,
                  const cv::Mat& mask) {
  cv::Mat full;
  const cv::Size size(view.camera->width, view.camera->height);
  cv::resize(mask, full, size, 0, 0, cv::INTER_LINEAR);
  full = full >= 128;
  if (capture.memory) {
    capture.memory->add_mask(view.camera->name, frame,
                             {full.cols, full.rows, 1, {full.datastart, full.dataend}});
  }
  if (capture.memory_only) return {};
  return write_png(capture.mask_path(*view.camera, frame), full);
}

Result<Background> find_background(const PreparedCapture& capture, const View& view,
                                   bool use_masks) {
  std::vector<cv::Mat> samples, masks;
  const int count = std::min(capture.frames, kBackgroundSamples);
  for (int i = 0; i < count; ++i) {
    const int frame = count == 1 ? 0 : int(std::int64_t(i) * (capture.frames - 1) / (count - 1));
    STGS_ASSIGN(samples.emplace_back(), load_image(capture, view, frame));
    masks.emplace_back();
    if (!use_masks) continue;
    STGS_ASSIGN(cv::Mat mask, load_mask_image(capture, view, frame));
    // Masks from other tools often exclude the blurred border of an object.
    if (!mask.empty()) cv::dilate(mask, masks.back(), cv::Mat(), {-1, -1}, 2);
  }
  return median_of(samples, masks);
}

// The flow of one camera, given or found.
class FlowFinder {
 public:
  FlowFinder(const PreparedCapture& capture, const View& view, const InitSettings& settings)
      : capture_(capture), view_(view), settings_(settings) {
    if (std::max(view.width, view.height) <= 320) dis_->setFinestScale(0);
  }

  // Returns the flow from a frame to the next.
  Result<cv::Mat> find(int frame, const cv::Mat& image, const cv::Mat& next) {
    STGS_ASSIGN(cv::Mat flow, given_flow(capture_, view_, settings_, frame));
    return flow.empty() ? checked_flow(*dis_, grey_of(image), grey_of(next)) : flow;
  }

 private:
  const PreparedCapture& capture_;
  const View& view_;
  const InitSettings& settings_;
  cv::Ptr<cv::DISOpticalFlow> dis_ = cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM);
};

// Returns a given mask; without one nothing moves.
Result<cv::Mat> mask_of(const PreparedCapture& capture, const View& view, int frame) {
  STGS_ASSIGN(cv::Mat mask, load_mask_image(capture, view, frame));
  if (mask.empty()) mask = cv::Mat(view.size(), CV_8U, cv::Scalar(0));
  return mask;
}

float share_of(const cv::Mat& mask) {
  return float(cv::countNonZero(mask)) / float(mask.total());
}

Status measure_coverage(const PreparedCapture& capture, const View& view, const Work& work,
                        ViewMotion* motion) {
  for (int frame = 0; frame < capture.frames; ++frame) {
    STGS_TRY(work.check());
    STGS_ASSIGN(const cv::Mat mask, mask_of(capture, view, frame));
    motion->coverage[frame] = share_of(mask);
  }
  return {};
}

// Reads the given flow of all frames, so that missing files are reported.
Status take_given_flow(const PreparedCapture& capture, const View& view,
                       const InitSettings& settings, const Work& work, ViewMotion* motion) {
  for (int frame = 0; frame + 1 < capture.frames; ++frame) {
    STGS_TRY(work.check());
    STGS_ASSIGN(const cv::Mat flow, given_flow(capture, view, settings, frame));
    if (flow.empty()) return {};
    STGS_ASSIGN(const cv::Mat mask, mask_of(capture, view, frame));
    motion->flow[frame] = pack_flow(flow, mask);
    motion->has_flow[frame] = 1;
  }
  return {};
}

Status write_masks(const PreparedCapture& capture, const View& view, const InitSettings& settings,
                   const Background& background, const Work& work, ViewMotion* motion) {
  const cv::Mat threshold = change_threshold(background.colour, background.noise);
  FlowFinder finder(capture, view, settings);
  STGS_ASSIGN(cv::Mat image, load_image(capture, view, 0));
  cv::Mat arriving(view.size(), CV_8U, cv::Scalar(0));  // moving by the flow into this frame
  for (int frame = 0; frame < capture.frames; ++frame) {
    STGS_TRY(work.check());
    cv::Mat next, flow, leaving(view.size(), CV_8U, cv::Scalar(0));
    if (frame + 1 < capture.frames) {
      STGS_ASSIGN(next, load_image(capture, view, frame + 1));
      STGS_ASSIGN(flow, finder.find(frame, image, next));
      leaving = moving_by_flow(flow);
    }
    cv::Mat change;
    difference(image, background.colour).convertTo(change, CV_32F);
    const cv::Mat flowing = leaving | arriving;
    const cv::Mat weak = (change > threshold) | (flowing & (change > 0.5 * threshold));
    const cv::Mat strong = (change > 2.0 * threshold) | (flowing & weak);
    const cv::Mat mask = clean(weak, strong);
    STGS_TRY(write_mask(capture, view, frame, mask));
    motion->coverage[frame] = share_of(mask);
    motion->flow[frame] = pack_flow(flow, mask);
    motion->has_flow[frame] = 1;
    arriving = leaving;
    image = next;
  }
  return {};
}

}  // namespace

bool FlowPatch::at(double u, double v, cv::Vec2d* flow) const {
  if (vectors.empty() || u < 0 || v < 0) return false;
  const int x = int(u / step) - box.x, y = int(v / step) - box.y;
  if (x < 0 || y < 0 || x >= box.width || y >= box.height) return false;
  const cv::Vec2s f = vectors.at<cv::Vec2s>(y, x);
  if (f[0] == kNoFlow) return false;
  *flow = {f[0] * kUnit, f[1] * kUnit};
  return true;
}

Status find_motion(const PreparedCapture& capture, const View& view, const InitSettings& settings,
                   const Work& work, ViewMotion* motion) {
  namespace fs = std::filesystem;
  motion->given_masks = has_mask(capture, *view.camera, 0);
  STGS_ASSIGN(const Background background, find_background(capture, view, motion->given_masks));
  motion->background = background.colour;
  motion->background_valid = background.valid;
  motion->flow.resize(capture.frames);
  motion->has_flow.assign(capture.frames, 0);
  motion->coverage.assign(capture.frames, 0);
  if (!motion->given_masks && !capture.memory_only) {
    std::error_code error;
    fs::create_directories(fs::path(capture.mask_path(*view.camera, 0)).parent_path(), error);
    if (error)
      return io_error("{}/masks: cannot create the folder: {}", capture.folder, error.message());
  }
  if (!motion->given_masks) return write_masks(capture, view, settings, background, work, motion);
  STGS_TRY(measure_coverage(capture, view, work, motion));
  return take_given_flow(capture, view, settings, work, motion);
}

Status find_frame_flow(const PreparedCapture& capture, const View& view,
                       const InitSettings& settings, int frame, ViewMotion* motion) {
  if (motion->has_flow[frame] != 0) return {};
  STGS_ASSIGN(const cv::Mat image, load_image(capture, view, frame));
  STGS_ASSIGN(const cv::Mat next, load_image(capture, view, frame + 1));
  STGS_ASSIGN(const cv::Mat mask, mask_of(capture, view, frame));
  STGS_ASSIGN(const cv::Mat flow, FlowFinder(capture, view, settings).find(frame, image, next));
  motion->flow[frame] = pack_flow(flow, mask);
  motion->has_flow[frame] = 1;
  return {};
}

}  // namespace stgs::encoder::init
