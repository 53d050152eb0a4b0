// SPDX-License-Identifier: Apache-2.0
// Training windows of a long capture: train one of them, or all in sequence.
#pragma once

#include <string>
#include <vector>

#include "arguments.h"
#include "session.h"
#include "stgs/encoder/train.h"
#include "stgs/encoder/windows.h"

namespace stgs::tools {

class WindowOptions {
 public:
  void declare(Arguments& app);

  // Returns whether --output is a folder of windows.
  bool has_windows() const { return length_ > 0; }
  // Returns the capture, or the window of it that --frames selects.
  Result<encoder::PreparedCapture> capture(const std::string& folder) const;
  // With --window: returns the windows to train, all or the one of --window-index.
  Result<std::vector<encoder::FrameSpan>> spans(const encoder::PreparedCapture& capture) const;
  // With --window: kUsage if the folder contains a window of another capture or plan, since all
  // windows of a folder are packed into one file. The folder need not exist.
  Status check_folder(const encoder::PreparedCapture& capture, const std::string& folder) const;

 private:
  std::string frames_;
  bool allow_outside_ = false;
  int length_ = 0, overlap_ = 0, index_ = -1;
};

// Trains each window into folder/FIRST-END.stgs and skips those that exist. An interrupted window
// leaves a checkpoint next to its file; the next call resumes from it. Each window writes its
// report to a subfolder of `report_folder` unless that is "". Prints the result of 'train'.
Status train_windows(const encoder::PreparedCapture& capture,
                     const std::vector<encoder::FrameSpan>& spans, const std::string& folder,
                     const std::string& title, const std::string& report_folder,
                     const encoder::TrainSettings& settings, Session& session);

}  // namespace stgs::tools
