// SPDX-License-Identifier: Apache-2.0
// The windows of a long capture: 'train' on one of them, or on all, one after the other.
#pragma once

#include <string>
#include <vector>

#include "session.h"
#include "stgs/encoder/train.h"
#include "stgs/encoder/windows.h"

namespace CLI {
class App;
}

namespace stgs::tools {

class WindowOptions {
 public:
  void declare(CLI::App& app);

  // Whether --output is a folder of windows.
  bool several() const { return length_ > 0; }
  // The capture, or the window of it that --frames asks for.
  Result<encoder::PreparedCapture> capture(const std::string& folder) const;
  // With --window: the windows to train, all or that of --window-index.
  Result<std::vector<encoder::FrameSpan>> spans(const encoder::PreparedCapture& capture) const;
  // With --window: kUsage, with what to do, where a window in the folder, which may not be there
  // yet, is none of the capture and this plan: all of a folder's windows go into one file.
  Status check_folder(const encoder::PreparedCapture& capture, const std::string& folder) const;

 private:
  std::string frames_;
  int length_ = 0, overlap_ = 0, part_ = -1;
};

// Trains each window into folder/FIRST-END.stgs, but for those that are there already. An
// interrupted one leaves its checkpoint beside its file, from which the next call goes on. With
// `report_folder`, each window's report is a folder in it. Prints what 'train' prints.
Status train_windows(const encoder::PreparedCapture& capture,
                     const std::vector<encoder::FrameSpan>& spans, const std::string& folder,
                     const std::string& report_folder, const encoder::TrainSettings& settings,
                     Session& session);

}  // namespace stgs::tools
