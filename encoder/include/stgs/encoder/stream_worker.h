// SPDX-License-Identifier: Apache-2.0
// Trains windows for a StreamEncoder in another process, which may run on another machine.
#pragma once

#include <memory>
#include <string>

#include "stgs/encoder/prepare.h"
#include "stgs/encoder/stream_encoder.h"
#include "stgs/encoder/trained_window.h"

namespace stgs::encoder {

class WindowTrainer;

// One thread at a time.
class StreamWorker {
 public:
  // `folder` is that of the StreamEncoder, which has been opened. Errors of the settings as
  // StreamEncoder::open(); kUsage if the encoder has another capture or other settings.
  static Result<std::unique_ptr<StreamWorker>> open(const std::string& folder,
                                                    const StreamSettings& settings);
  ~StreamWorker();

  // Trains a window against the persistent set that the folder has for the begin of its round.
  // `frames`: of the recording, from there, more than 0, to the end of the window.
  Result<TrainedWindow> train_window(const PreparedCapture& window, FrameSpan frames,
                                     const ProgressSink& progress, const LogSink& log);

 private:
  StreamWorker(std::string folder, std::unique_ptr<WindowTrainer> trainer);

  std::string folder_;
  std::unique_ptr<WindowTrainer> trainer_;
};

}  // namespace stgs::encoder
