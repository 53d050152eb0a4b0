// SPDX-License-Identifier: Apache-2.0
// Finds cameras whose frames were taken earlier or later than those of the others.
#pragma once

#include <future>
#include <vector>

#include "init/calibration_check.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// A camera whose frame f was taken at the time of frame f - frames of the others.
struct LateCamera {
  int view = 0;
  int frames = 0;  // negative: it is ahead of the others
};

// Matches moving content, which the masks of the capture show, between each view and its likely
// partners in frames that are up to kMaxDelay apart. The matches are nearest to their epipolar
// lines in frames of the same time. Finds nothing in short clips, and where too little moves.
// Skips the outliers of the calibration, because their epipolar lines are wrong.
Status check_timing(const PreparedCapture& capture, const std::vector<View>& views,
                    const CalibrationCheck& calibration, Work& work, std::vector<LateCamera>* out);

// Runs the check in parallel with other stages, because only reports depend on its result.
class TimingCheck {
 public:
  TimingCheck() = default;
  // Cancels the check and waits for it.
  ~TimingCheck() { background_.cancel(); }
  TimingCheck(const TimingCheck&) = delete;
  TimingCheck& operator=(const TimingCheck&) = delete;

  // Starts the check on the caller's TaskRunner. The arguments must outlive the object.
  void start(const PreparedCapture& capture, const std::vector<View>& views,
             const CalibrationCheck& calibration);
  // Waits for the check, in the stage "timing". Nothing is found if it was not started.
  Status wait(Work& work, std::vector<LateCamera>* out);

 private:
  const ProgressSink no_progress_;
  const LogSink no_log_;
  Work background_{no_progress_, no_log_};
  std::vector<LateCamera> late_;
  std::future<Status> check_;  // its destructor joins the thread
};

inline constexpr int kMaxDelay = 3;  // frames

}  // namespace stgs::encoder::init
