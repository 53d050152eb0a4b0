// SPDX-License-Identifier: Apache-2.0
#include "init/motion.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "init/background.h"
#include "init/motion_gpu.h"
#include "init/point_frames.h"

namespace stgs::encoder::init {
namespace {

using geometry::kMinFlowSide;

// Margin around dynamic content, over the image width: the upper bound of plausible motion.
constexpr double kFlowMargin = 1.0 / 15;
constexpr int kLearntImages = 3;  // of a window, by a live background

cv::Mat grey_of(const cv::Mat& rgb) {
  cv::Mat grey;
  cv::cvtColor(rgb, grey, cv::COLOR_RGB2GRAY);
  return grey;
}

cv::Mat not_a_number(cv::Size size) {
  return cv::Mat(size, CV_32FC2, cv::Scalar::all(std::numeric_limits<double>::quiet_NaN()));
}

float length(const cv::Vec2f& flow) {
  return std::sqrt(flow.dot(flow));
}

// Returns the dense flow from a to b, NaN where the backward flow disagrees. All NaN for images too
// small for DIS.
cv::Mat checked_flow(cv::DISOpticalFlow& dis, const cv::Mat& a, const cv::Mat& b) {
  if (a.cols < kMinFlowSide || a.rows < kMinFlowSide) return not_a_number(a.size());
  cv::Mat forward, back;
  dis.calc(a, b, forward);
  dis.calc(b, a, back);
  for (int y = 0; y < a.rows; ++y) {
    for (int x = 0; x < a.cols; ++x) {
      cv::Vec2f& f = forward.at<cv::Vec2f>(y, x);
      const int tx = x + cvRound(f[0]), ty = y + cvRound(f[1]);
      bool good = tx >= 0 && ty >= 0 && tx < a.cols && ty < a.rows;
      if (good) {
        const cv::Vec2f r = back.at<cv::Vec2f>(ty, tx);
        good = length(f + r) < geometry::kRoundTrip + geometry::kRoundTripShare * length(f);
      }
      if (!good) f = cv::Vec2f::all(std::numeric_limits<float>::quiet_NaN());
    }
  }
  return forward;
}

FlowPatch pack_flow(const cv::Mat& flow, const cv::Mat& mask) {
  FlowPatch patch;
  patch.step = kFlowStep;
  if (flow.empty()) return patch;
  patch.box = packed_box(mask);
  patch.vectors = cv::Mat(patch.box.size(), CV_16SC2, cv::Scalar::all(FlowPatch::kNoFlow));
  for (int y = 0; y < patch.box.height; ++y) {
    for (int x = 0; x < patch.box.width; ++x) {
      const int px = std::min(kFlowStep * (patch.box.x + x), flow.cols - 1);
      const int py = std::min(kFlowStep * (patch.box.y + y), flow.rows - 1);
      const cv::Vec2f f = flow.at<cv::Vec2f>(py, px);
      if (!mask.at<std::uint8_t>(py, px) || !geometry::is_known_flow({f[0], f[1]})) continue;
      patch.vectors.at<cv::Vec2s>(y, x) = {short(geometry::packed_flow(f[0])),
                                           short(geometry::packed_flow(f[1]))};
    }
  }
  return patch;
}

// Returns the part of the image that shows dynamic content, with a margin.
cv::Rect part_with(const cv::Mat& mask) {
  const cv::Rect box = cv::boundingRect(mask);
  if (box.empty()) return box;
  const int margin = std::max(kMinFlowSide, int(std::lround(kFlowMargin * mask.cols)));
  return cv::Rect(box.x - margin, box.y - margin, box.width + 2 * margin, box.height + 2 * margin) &
         cv::Rect({0, 0}, mask.size());
}

// The flow of one camera, given or found.
class FlowFinder {
 public:
  FlowFinder(const PreparedCapture& capture, const View& view, const InitSettings& settings)
      : capture_(capture), view_(view), settings_(settings) {
    if (std::max(view.width, view.height) <= geometry::kFullFlowSide) dis_->setFinestScale(0);
  }

  // Returns the flow from a frame to the next. Searched only in `part`, NaN elsewhere.
  Result<cv::Mat> find(int frame, const cv::Mat& image, const cv::Mat& next, cv::Rect part) {
    STGS_ASSIGN(cv::Mat flow, given_flow(capture_, view_, settings_, frame));
    if (!flow.empty()) return flow;
    flow = not_a_number(image.size());
    if (!part.empty())
      checked_flow(*dis_, grey_of(image(part)), grey_of(next(part))).copyTo(flow(part));
    return flow;
  }

 private:
  const PreparedCapture& capture_;
  const View& view_;
  const InitSettings& settings_;
  // Slower presets change 5 % of the masks, but not the quality of training.
  cv::Ptr<cv::DISOpticalFlow> dis_ =
      cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_ULTRAFAST);
};

// Returns a given mask; without one nothing moves.
Result<cv::Mat> mask_of(const PreparedCapture& capture, const View& view, int frame) {
  STGS_ASSIGN(cv::Mat mask, load_mask_image(capture, view, frame));
  if (mask.empty()) mask = cv::Mat(view.size(), CV_8U, cv::Scalar(0));
  return mask;
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
  const ChangeTest test =
      change_test(background.colour, change_threshold(background.colour, background.noise));
  FlowFinder finder(capture, view, settings);
  STGS_ASSIGN(cv::Mat image, load_image(capture, view, 0));
  cv::Mat arriving(view.size(), CV_8U, cv::Scalar(0));  // moving by the flow into this frame
  for (int frame = 0; frame < capture.frames; ++frame) {
    STGS_TRY(work.check());
    cv::Mat next, flow, leaving(view.size(), CV_8U, cv::Scalar(0));
    if (frame + 1 < capture.frames) {
      STGS_ASSIGN(next, load_image(capture, view, frame + 1));
      STGS_ASSIGN(flow, finder.find(frame, image, next, cv::Rect({0, 0}, image.size())));
      leaving = moving_by_flow(flow);
    }
    const cv::Mat mask = motion_mask(image, test, cv::Mat(leaving | arriving));
    STGS_TRY(add_mask(capture, view, frame, mask));
    motion->coverage[frame] = share_of(mask);
    motion->flow[frame] = pack_flow(flow, mask);
    motion->has_flow[frame] = 1;
    arriving = leaving;
    image = next;
  }
  return {};
}

// Returns the frames of a live window that get masks.
std::vector<int> masked_frames(const PreparedCapture& capture, const View& view, int interval) {
  std::vector<int> frames = point_frames(capture.frames, interval);
  std::erase_if(frames, [&](int frame) { return !has_frame(capture, *view.camera, frame); });
  return frames;
}

Status find_masks(const PreparedCapture& capture, const View& view,
                  const LiveBackground& background, const std::vector<int>& frames,
                  const Work& work, const MaskSink& take) {
  for (const int frame : frames) {
    STGS_TRY(work.check());
    STGS_ASSIGN(const cv::Mat image, load_image(capture, view, frame));
    STGS_TRY(take(frame, background.mask(image)));
  }
  return {};
}

}  // namespace

cv::Mat moving_by_flow(const cv::Mat& flow) {
  cv::Mat mask(flow.size(), CV_8U, cv::Scalar(0));
  std::vector<float> lengths;
  for (int y = 0; y < flow.rows; y += 2) {
    for (int x = 0; x < flow.cols; x += 2) {
      const auto& f = flow.at<cv::Vec2f>(y, x);
      if (f[0] == f[0]) lengths.push_back(length(f));
    }
  }
  if (lengths.empty()) return mask;
  std::nth_element(lengths.begin(), lengths.begin() + lengths.size() / 2, lengths.end());
  const float threshold = geometry::moving_length_of(lengths[lengths.size() / 2]);
  for (int y = 0; y < flow.rows; ++y) {
    for (int x = 0; x < flow.cols; ++x) {
      const auto& f = flow.at<cv::Vec2f>(y, x);
      if (length(f) > threshold) mask.at<std::uint8_t>(y, x) = 255;
    }
  }
  return mask;
}

bool FlowPatch::at(double u, double v, cv::Vec2d* flow) const {
  if (vectors.empty() || u < 0 || v < 0) return false;
  const int x = int(u / step) - box.x, y = int(v / step) - box.y;
  if (x < 0 || y < 0 || x >= box.width || y >= box.height) return false;
  const cv::Vec2s f = vectors.at<cv::Vec2s>(y, x);
  if (f[0] == kNoFlow) return false;
  *flow = {f[0] * kUnit, f[1] * kUnit};
  return true;
}

cv::Rect packed_box(const cv::Mat& mask) {
  const cv::Rect full = cv::boundingRect(mask);
  return {full.x / kFlowStep, full.y / kFlowStep, (full.width + kFlowStep - 1) / kFlowStep,
          (full.height + kFlowStep - 1) / kFlowStep};
}

Status find_motion(const PreparedCapture& capture, const View& view, const InitSettings& settings,
                   geometry::MotionFinder* gpu, const Work& work, ViewMotion* motion) {
  namespace fs = std::filesystem;
  motion->given_masks = has_mask(capture, *view.camera, 0);
  STGS_ASSIGN(const Background background,
              gpu != nullptr ? find_gpu_background(*gpu, capture, view, motion->given_masks)
                             : find_background(capture, view, motion->given_masks));
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
  if (!motion->given_masks) {
    return gpu != nullptr ? write_gpu_masks(*gpu, capture, view, settings, background, work, motion)
                          : write_masks(capture, view, settings, background, work, motion);
  }
  STGS_TRY(measure_coverage(capture, view, work, motion));
  return take_given_flow(capture, view, settings, work, motion);
}

Status find_live_motion(const PreparedCapture& capture, const View& view,
                        const InitSettings& settings, geometry::MotionFinder* gpu, const Work& work,
                        ViewMotion* motion) {
  LiveBackground* known = settings.live->find(view.camera->name);
  if (known == nullptr) {
    STGS_ASSIGN(Background first, gpu != nullptr ? find_gpu_background(*gpu, capture, view, false)
                                                 : find_background(capture, view, false));
    known = &settings.live->add(view.camera->name, std::move(first));
  }
  known->resize(view.size());
  motion->background = known->background().colour.clone();
  motion->background_valid = known->background().valid.clone();
  motion->coverage.assign(capture.frames, 0);
  cv::Mat masked(view.size(), CV_8U, cv::Scalar(0));
  const MaskSink take = [&](int frame, const cv::Mat& mask) -> Status {
    STGS_TRY(add_mask(capture, view, frame, mask));
    motion->coverage[frame] = share_of(mask);
    masked |= mask;
    return {};
  };
  const std::vector<int> frames = masked_frames(capture, view, settings.point_interval);
  STGS_TRY(gpu != nullptr
               ? find_gpu_masks(*gpu, capture, view, known->background(), frames, work, take)
               : find_masks(capture, view, *known, frames, work, take));
  std::vector<cv::Mat> learnt;
  for (int i = 0; i < kLearntImages; ++i) {
    const int frame = i * (capture.frames - 1) / (kLearntImages - 1);
    if (!has_frame(capture, *view.camera, frame)) continue;
    STGS_ASSIGN(learnt.emplace_back(), load_image(capture, view, frame));
  }
  known->learn(learnt, masked, capture.frames);
  add_still(capture, view, known->still());
  return {};
}

Status find_frame_flow(const PreparedCapture& capture, const View& view,
                       const InitSettings& settings, geometry::MotionFinder* gpu, int frame,
                       ViewMotion* motion) {
  if (motion->has_flow[frame] != 0) return {};
  if (gpu != nullptr) return find_gpu_flow(*gpu, capture, view, frame, motion);
  STGS_ASSIGN(const cv::Mat image, load_image(capture, view, frame));
  STGS_ASSIGN(const cv::Mat next, load_image(capture, view, frame + 1));
  STGS_ASSIGN(const cv::Mat mask, mask_of(capture, view, frame));
  FlowFinder finder(capture, view, settings);
  STGS_ASSIGN(const cv::Mat flow, finder.find(frame, image, next, part_with(mask)));
  motion->flow[frame] = pack_flow(flow, mask);
  motion->has_flow[frame] = 1;
  return {};
}

}  // namespace stgs::encoder::init
