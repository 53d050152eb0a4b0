// SPDX-License-Identifier: Apache-2.0
#include "init/timing_check.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <opencv2/imgproc.hpp>
#include <set>

#include "init/epipolar.h"
#include "init/image_matches.h"
#include "stgs/format/task_runner.h"

namespace stgs::encoder::init {
namespace {

constexpr int kDelays = 2 * kMaxDelay + 1;  // from -kMaxDelay to kMaxDelay
constexpr int kTimes = 2;                   // at most, at which frames are compared
constexpr std::size_t kMaxMoving = 400;     // of the moving content of a frame
constexpr int kMargin = 24;                 // around it, pixels, because features have a size
constexpr double kOnLine = 1;               // pixels
// Least evidence of a late camera: matches on their lines at a delay, the ratio to those without a
// delay, and pairs of views that agree.
constexpr int kMinOnLine = 24;
constexpr double kMinRatio = 1.6;
constexpr int kMinAgreeing = 2;
constexpr int kClearlyOnLine = 60;  // matches of a camera that show that it is in time

using Counts = std::array<int, kDelays>;

// The matches of two views on their epipolar lines; entry d is between a frame of a and one of b
// that is d - kMaxDelay frames later.
struct PairCounts {
  int a = 0, b = 0;
  Counts on_line{};
};

Result<Features> moving_features(const PreparedCapture& capture, const View& view, int frame) {
  STGS_ASSIGN(const cv::Mat mask, load_mask_image(capture, view, frame));
  if (mask.empty() || cv::countNonZero(mask) == 0) return Features{};
  STGS_ASSIGN(const cv::Mat image, load_image(capture, view, frame));
  const cv::Rect moving = cv::boundingRect(mask);
  const cv::Rect box = cv::Rect(moving.x - kMargin, moving.y - kMargin, moving.width + 2 * kMargin,
                                moving.height + 2 * kMargin) &
                       cv::Rect({0, 0}, mask.size());
  Features out = find_features(image(box), 4 * kMaxMoving, mask(box));
  if (out.points.size() > kMaxMoving) {
    out.points.resize(kMaxMoving);
    out.descriptors = out.descriptors.rowRange(0, static_cast<int>(kMaxMoving));
  }
  for (cv::Point2d& point : out.points) point += cv::Point2d(box.tl());
  return out;
}

int count_on_line(const Features& a, const Features& b, const cv::Matx33d& f) {
  int count = 0;
  for (const auto& [i, j] : match_features(a, b))
    count += epipolar_distance(f, a.points[i], b.points[j]) < kOnLine ? 1 : 0;
  return count;
}

// The features of the views from a time on, by the number of frames after it.
using FeaturesAfter = std::vector<std::array<Features, kMaxDelay + 1>>;

// Adds the counts of the delays from `least` to `most`, in both directions, to all pairs. Finds the
// features of the frames that are `least` to `most` after frame `time`.
Status count_pairs(const PreparedCapture& capture, const std::vector<View>& views, int time,
                   int least, int most, Work& work, FeaturesAfter* features,
                   std::vector<PairCounts>* pairs) {
  const int frames = most - least + 1;
  STGS_TRY(work.for_each(int(views.size()) * frames, [&](int i) -> Status {
    const int view = i / frames, later = least + i % frames;
    STGS_ASSIGN((*features)[view][later], moving_features(capture, views[view], time + later));
    return {};
  }));
  return work.for_each(int(pairs->size()), [&](int i) -> Status {
    PairCounts& pair = (*pairs)[i];
    const auto &a = (*features)[pair.a], &b = (*features)[pair.b];
    const cv::Matx33d f = fundamental_of(views[pair.a], views[pair.b]);
    for (int d = least; d <= most; ++d) {
      pair.on_line[kMaxDelay + d] += count_on_line(a[0], b[d], f);
      if (d > 0) pair.on_line[kMaxDelay - d] += count_on_line(a[d], b[0], f);
    }
    return {};
  });
}

// The matches of a camera by its delay, relative to the known delays of the others.
struct Votes {
  Counts matches{}, pairs{};  // `pairs`: those with more matches than without a delay
};

Votes votes_of(int view, const std::vector<PairCounts>& pairs, const std::vector<int>& delays) {
  Votes votes;
  for (const PairCounts& pair : pairs) {
    if (pair.a != view && pair.b != view) continue;
    // Frame t of a view that is late by x has the time of frame t - x + y of one late by y.
    const auto at = [&](int delay) {
      const int x = pair.a == view ? delay : delays[pair.a];
      const int y = pair.b == view ? delay : delays[pair.b];
      const int d = y - x + kMaxDelay;
      return d >= 0 && d < kDelays ? pair.on_line[d] : 0;
    };
    for (int d = 0; d < kDelays; ++d) {
      votes.matches[d] += at(d - kMaxDelay);
      votes.pairs[d] += at(d - kMaxDelay) > at(0) ? 1 : 0;
    }
  }
  return votes;
}

// The delay of a camera that shows most clearly; `frames` is 0 if none does.
LateCamera find_latest(const std::vector<PairCounts>& pairs, const std::vector<int>& delays) {
  LateCamera found;
  double best = kMinRatio;
  for (int view = 0; view < static_cast<int>(delays.size()); ++view) {
    if (delays[view] != 0) continue;
    const Votes votes = votes_of(view, pairs, delays);
    for (int d = 0; d < kDelays; ++d) {
      const double ratio = votes.matches[d] / (votes.matches[kMaxDelay] + 1.0);
      if (votes.matches[d] < kMinOnLine || votes.pairs[d] < kMinAgreeing || ratio <= best) continue;
      best = ratio;
      found = {view, d - kMaxDelay};
    }
  }
  return found;
}

// Returns whether all cameras with pairs have many matches without a delay, and not more with any.
bool are_in_time(const std::vector<PairCounts>& pairs, const std::vector<int>& delays) {
  std::set<int> paired;
  for (const PairCounts& pair : pairs) paired.insert({pair.a, pair.b});
  for (const int view : paired) {
    const Counts matches = votes_of(view, pairs, delays).matches;
    const int most = *std::max_element(matches.begin(), matches.end());
    if (matches[kMaxDelay] < kClearlyOnLine || matches[kMaxDelay] < most) return false;
  }
  return true;
}

}  // namespace

Status check_timing(const PreparedCapture& capture, const std::vector<View>& views,
                    const CalibrationCheck& calibration, Work& work, std::vector<LateCamera>* out) {
  out->clear();
  if (views.size() <= kMinAgreeing || capture.frames < kDelays) return {};
  std::set<int> distinct;
  for (int k = 1; k <= kTimes; ++k) {
    distinct.insert(std::min(k * capture.frames / (kTimes + 1), capture.frames - 1 - kMaxDelay));
  }
  const std::vector<int> times(distinct.begin(), distinct.end());
  work.stage("timing", 4 * static_cast<int>(times.size()));
  std::vector<PairCounts> pairs;
  for (const auto& [a, b] : likely_pairs(views)) {
    if (!calibration.is_outlier(a) && !calibration.is_outlier(b)) pairs.push_back({a, b, {}});
  }
  std::vector<int> delays(views.size(), 0);
  std::vector<FeaturesAfter> features(times.size(), FeaturesAfter(views.size()));
  // A camera that is in time has fewer matches with the frame before and the frame after, and the
  // matches become fewer with the delay. Longer ones matter only in doubt.
  const std::pair<int, int> ranges[] = {{0, 1}, {2, kMaxDelay}};
  for (const auto& [least, most] : ranges) {
    for (std::size_t k = 0; k < times.size(); ++k) {
      STGS_TRY(count_pairs(capture, views, times[k], least, most, work, &features[k], &pairs));
      if (are_in_time(pairs, delays)) return {};
    }
  }
  // One by one, because a late camera makes its partners look early. Most are in time.
  while (2 * (out->size() + 1) < views.size()) {
    const LateCamera late = find_latest(pairs, delays);
    if (late.frames == 0) break;
    delays[late.view] = late.frames;
    out->push_back(late);
  }
  return {};
}

void TimingCheck::start(const PreparedCapture& capture, const std::vector<View>& views,
                        const CalibrationCheck& calibration) {
  check_ = std::async(std::launch::async, [&, runner = task_runner()] {
    const ScopedTaskRunner use(runner);
    return guarded("timing",
                   [&] { return check_timing(capture, views, calibration, background_, &late_); });
  });
}

Status TimingCheck::wait(Work& work, std::vector<LateCamera>* out) {
  out->clear();
  if (!check_.valid()) return {};
  work.stage("timing");
  const auto ready = [&]() -> Status {
    while (check_.wait_for(std::chrono::milliseconds(20)) != std::future_status::ready)
      STGS_TRY(work.check());
    return {};
  };
  STGS_TRY(work.wait_for(ready));
  STGS_TRY(check_.get());
  *out = std::move(late_);
  return {};
}

}  // namespace stgs::encoder::init
