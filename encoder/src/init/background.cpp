// SPDX-License-Identifier: Apache-2.0
#include "init/background.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "geometry/masked_median.h"
#include "geometry/motion_rule.h"
#include "init/components.h"
#include "stgs/encoder/frame_memory.h"

namespace stgs::encoder::init {
namespace {

constexpr int kBackgroundSamples = 25;
static_assert(std::size_t{kBackgroundSamples} <= geometry::kMaxMedianSamples);
// Fraction of the difference to a static image by which the background adapts per window.
constexpr double kAdaption = 0.125;

// The medians of one channel, 8-bit, and how many samples count at each pixel.
struct ChannelMedian {
  cv::Mat median, counts;
};

ChannelMedian median_of_channel(const std::vector<cv::Mat>& channel,
                                const std::vector<cv::Mat>& masks) {
  std::vector<const std::uint8_t*> samples, masked;
  for (const cv::Mat& sample : channel) samples.push_back(sample.data);
  for (const cv::Mat& mask : masks) masked.push_back(mask.empty() ? nullptr : mask.data);
  ChannelMedian out{cv::Mat(channel[0].size(), CV_8U), cv::Mat(channel[0].size(), CV_8U)};
  geometry::masked_median(samples, masked, channel[0].total(), out.median.data, out.counts.data);
  return out;
}

// Returns the median of each channel over the samples whose mask is 0 (an empty mask is 0
// everywhere). The noise is the median over pixels of the median absolute deviation of green.
Background median_of(const std::vector<cv::Mat>& samples, const std::vector<cv::Mat>& masks) {
  Background out;
  cv::Mat channels[3], counts;
  for (int k = 0; k < 3; ++k) {
    std::vector<cv::Mat> channel(samples.size());
    for (std::size_t s = 0; s < samples.size(); ++s) cv::extractChannel(samples[s], channel[s], k);
    ChannelMedian found = median_of_channel(channel, masks);
    channels[k] = found.median;
    counts = found.counts;
    if (k != 1) continue;
    for (cv::Mat& green : channel) cv::absdiff(green, found.median, green);
    const cv::Mat deviations = median_of_channel(channel, masks).median;
    std::uint32_t deviating[256] = {};
    for (std::size_t i = 0; i < deviations.total(); ++i)
      if (found.counts.data[i] != 0) ++deviating[deviations.data[i]];
    out.noise = geometry::noise_of(deviating);
  }
  cv::merge(channels, 3, out.colour);
  out.valid = counts > 0;
  return out;
}

bool has_pixel(const cv::Mat& mask, const Run& run) {
  const std::uint8_t* const row = mask.ptr(run.y);
  return std::find(row + run.first, row + run.last, 255) != row + run.last;
}

void set_pixels(const Run& run, cv::Mat* mask) {
  std::fill(mask->ptr(run.y) + run.first, mask->ptr(run.y) + run.last, std::uint8_t{255});
}

// Returns the components of `weak` with at least `smallest` pixels that contain a pixel of
// `strong`.
cv::Mat hysteresis(const cv::Mat& weak, const cv::Mat& strong, int smallest) {
  const Components found = find_components(weak, 255, true);
  std::vector<bool> is_strong(found.components.size(), false);
  for (const Run& run : found.runs)
    if (!is_strong[run.component]) is_strong[run.component] = has_pixel(strong, run);
  cv::Mat out(weak.size(), CV_8U, cv::Scalar(0));
  for (const Run& run : found.runs)
    if (is_strong[run.component] && found.components[run.component].area >= smallest)
      set_pixels(run, &out);
  return out;
}

// Fills small holes, because the uniform interior of a moving object shows no change.
void fill_holes(cv::Mat* mask) {
  const int largest = geometry::largest_hole(int(mask->total()));
  const Components found = find_components(*mask, 0, false);
  for (const Run& run : found.runs) {
    const Component& hole = found.components[run.component];
    if (!hole.at_border && hole.area <= largest) set_pixels(run, mask);
  }
}

// Returns an image after a light blur.
cv::Mat blurred(const cv::Mat& image) {
  cv::Mat out;
  cv::blur(image, out, {3, 3});
  return out;
}

// Returns the largest difference of a channel, 8-bit.
cv::Mat largest_difference(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat d;
  cv::absdiff(a, b, d);
  cv::Mat channels[3];
  cv::split(d, channels);
  return cv::max(cv::max(channels[0], channels[1]), channels[2]);
}

}  // namespace

cv::Mat difference(const cv::Mat& a, const cv::Mat& b) {
  return largest_difference(blurred(a), blurred(b));
}

cv::Mat change_threshold(const cv::Mat& background, double noise) {
  cv::Mat grey, dx, dy, slope;
  cv::cvtColor(background, grey, cv::COLOR_RGB2GRAY);
  cv::blur(grey, grey, {3, 3});
  cv::Sobel(grey, dx, CV_32F, 1, 0, 3, 1.0 / 8);
  cv::Sobel(grey, dy, CV_32F, 0, 1, 3, 1.0 / 8);
  cv::magnitude(dx, dy, slope);
  cv::dilate(slope, slope, cv::Mat());
  return cv::Mat(geometry::threshold_base(noise) + geometry::kSlopeShare * slope);
}

namespace {

// Returns the levels above which a change is above `scale` times its threshold, 8-bit.
cv::Mat level_of(const cv::Mat& threshold, float scale) {
  cv::Mat out(threshold.size(), CV_8U);
  for (int y = 0; y < out.rows; ++y) {
    for (int x = 0; x < out.cols; ++x) {
      // Truncated, because changes are whole levels.
      out.at<std::uint8_t>(y, x) =
          static_cast<std::uint8_t>(std::min(255.0f, scale * threshold.at<float>(y, x)));
    }
  }
  return out;
}

// Returns the motion mask: parts of `weak` that contain a pixel of `strong`, without specks and
// small holes.
cv::Mat clean_mask(const cv::Mat& weak, const cv::Mat& strong) {
  const int smallest = geometry::smallest_component(int(weak.total()));
  cv::Mat mask = hysteresis(weak, strong, smallest);
  cv::morphologyEx(mask, mask, cv::MORPH_CLOSE,
                   cv::getStructuringElement(cv::MORPH_ELLIPSE, {5, 5}));
  fill_holes(&mask);
  cv::morphologyEx(mask, mask, cv::MORPH_OPEN, cv::getStructuringElement(cv::MORPH_CROSS, {3, 3}));
  mask = hysteresis(mask, strong, smallest);
  cv::dilate(mask, mask, cv::getStructuringElement(cv::MORPH_CROSS, {3, 3}));
  return mask;
}

}  // namespace

ChangeTest change_test(const cv::Mat& background, const cv::Mat& threshold) {
  return {blurred(background), level_of(threshold, 1), level_of(threshold, geometry::kStrongChange),
          level_of(threshold, geometry::kFlowingChange)};
}

cv::Mat motion_mask(const cv::Mat& image, const ChangeTest& test, const cv::Mat& flowing) {
  const cv::Mat change = largest_difference(blurred(image), test.background);
  cv::Mat weak = change > test.weak, strong = change > test.strong;
  if (!flowing.empty()) {
    const cv::Mat confirmed = flowing & (change > test.flowing);
    weak |= confirmed;
    strong |= confirmed;
  }
  return clean_mask(weak, strong);
}

float share_of(const cv::Mat& mask) {
  return float(cv::countNonZero(mask)) / float(mask.total());
}

namespace {

// Returns a mask at the size of the camera.
cv::Mat full_size(const View& view, const cv::Mat& mask) {
  cv::Mat full;
  const cv::Size size(view.camera->width, view.camera->height);
  cv::resize(mask, full, size, 0, 0, cv::INTER_LINEAR);
  return full >= 128;
}

}  // namespace

void add_still(const PreparedCapture& capture, const View& view, const cv::Mat& mask) {
  const cv::Mat full = full_size(view, mask);
  capture.memory->add_still(view.camera->name,
                            {full.cols, full.rows, 1, {full.datastart, full.dataend}});
}

Status add_mask(const PreparedCapture& capture, const View& view, int frame, const cv::Mat& mask) {
  const cv::Mat full = full_size(view, mask);
  if (capture.memory) {
    capture.memory->add_mask(view.camera->name, frame,
                             {full.cols, full.rows, 1, {full.datastart, full.dataend}});
  }
  if (capture.memory_only) return {};
  return write_png(capture.mask_path(*view.camera, frame), full);
}

std::vector<int> background_frames(const PreparedCapture& capture, const View& view) {
  std::vector<int> out;
  const int count = std::min(capture.frames, kBackgroundSamples);
  for (int i = 0; i < count; ++i) {
    const int frame = count == 1 ? 0 : int(std::int64_t(i) * (capture.frames - 1) / (count - 1));
    if (has_frame(capture, *view.camera, frame)) out.push_back(frame);
  }
  return out;
}

Background unknown_background(const View& view) {
  return {cv::Mat(view.size(), CV_8UC3, cv::Scalar::all(0)),
          cv::Mat(view.size(), CV_8U, cv::Scalar(0)), 1};
}

Result<Background> find_background(const PreparedCapture& capture, const View& view,
                                   bool use_masks) {
  std::vector<cv::Mat> samples, masks;
  for (const int frame : background_frames(capture, view)) {
    STGS_ASSIGN(samples.emplace_back(), load_image(capture, view, frame));
    masks.emplace_back();
    if (!use_masks) continue;
    STGS_ASSIGN(cv::Mat mask, load_mask_image(capture, view, frame));
    if (!mask.empty()) cv::dilate(mask, masks.back(), cv::Mat(), {-1, -1}, geometry::kMaskReach);
  }
  return samples.empty() ? unknown_background(view) : median_of(samples, masks);
}

LiveBackground::LiveBackground(Background first, int settle_frames)
    : background_(std::move(first)),
      settle_frames_(settle_frames),
      candidate_(background_.colour.clone()),
      settled_(background_.colour.size(), CV_32S, cv::Scalar(0)),
      still_(background_.colour.size(), CV_32S, cv::Scalar(0)) {
  update();
}

void LiveBackground::update() {
  threshold_ = change_threshold(background_.colour, background_.noise);
  test_ = change_test(background_.colour, threshold_);
}

void LiveBackground::resize(cv::Size size) {
  if (background_.colour.size() == size) return;
  for (cv::Mat* image : {&background_.colour, &candidate_})
    cv::resize(*image, *image, size, 0, 0, cv::INTER_AREA);
  for (cv::Mat* map : {&background_.valid, &settled_, &still_})
    cv::resize(*map, *map, size, 0, 0, cv::INTER_NEAREST);
  update();
}

cv::Mat LiveBackground::mask(const cv::Mat& image) const {
  return motion_mask(image, test_);
}

cv::Mat LiveBackground::still() const {
  return still_ >= settle_frames_;
}

void LiveBackground::learn(const std::vector<cv::Mat>& images, const cv::Mat& masked, int frames) {
  if (images.size() < 2) return;
  const cv::Mat& last = images.back();
  cv::Mat moved(last.size(), CV_8U, cv::Scalar(0));  // largest change within the window
  for (std::size_t i = 0; i + 1 < images.size(); ++i)
    moved = cv::max(moved, difference(images[i], last));
  const cv::Mat changed = difference(last, background_.colour);
  const cv::Mat from_candidate = difference(last, candidate_);
  for (int y = 0; y < last.rows; ++y) {
    for (int x = 0; x < last.cols; ++x) {
      const float limit = threshold_.at<float>(y, x);
      int& settled = settled_.at<int>(y, x);
      int& still = still_.at<int>(y, x);
      cv::Vec3b& colour = background_.colour.at<cv::Vec3b>(y, x);
      const cv::Vec3b& now = last.at<cv::Vec3b>(y, x);
      const bool is_static = float(moved.at<std::uint8_t>(y, x)) <= limit;
      if (is_static && float(changed.at<std::uint8_t>(y, x)) <= limit) {
        for (int c = 0; c < 3; ++c)
          colour[c] = cv::saturate_cast<std::uint8_t>(colour[c] + kAdaption * (now[c] - colour[c]));
        settled = 0;
        still = masked.at<std::uint8_t>(y, x) != 0 ? 0 : still + frames;
        continue;
      }
      still = 0;
      const bool rests = is_static && float(from_candidate.at<std::uint8_t>(y, x)) <= limit;
      settled = !is_static ? 0 : (rests ? settled : 0) + frames;
      if (!rests) candidate_.at<cv::Vec3b>(y, x) = now;
      if (settled < settle_frames_) continue;
      colour = now;
      background_.valid.at<std::uint8_t>(y, x) = 255;
      still = settled;
      settled = 0;
    }
  }
  update();
}

LiveBackground* LiveBackgrounds::find(const std::string& camera) {
  const std::lock_guard lock(mutex_);
  const auto found = cameras_.find(camera);
  return found == cameras_.end() ? nullptr : found->second.get();
}

LiveBackground& LiveBackgrounds::add(const std::string& camera, Background first) {
  const std::lock_guard lock(mutex_);
  return *(cameras_[camera] = std::make_unique<LiveBackground>(std::move(first), settle_frames_));
}

}  // namespace stgs::encoder::init
