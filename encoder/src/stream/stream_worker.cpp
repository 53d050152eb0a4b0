// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/stream_worker.h"

#include <exception>
#include <utility>

#include "stream/window_trainer.h"

namespace stgs::encoder {

StreamWorker::StreamWorker(std::string folder, std::unique_ptr<WindowTrainer> trainer)
    : folder_(std::move(folder)), trainer_(std::move(trainer)) {}

StreamWorker::~StreamWorker() = default;

Result<std::unique_ptr<StreamWorker>> StreamWorker::open(const std::string& folder,
                                                         const StreamSettings& settings) {
  STGS_ASSIGN(WindowTrainer trainer, WindowTrainer::create(settings));
  STGS_ASSIGN(const bool is_same, trainer.is_run_of(folder));
  if (!is_same) {
    return usage_error(
        "{}: this process has another capture or other settings than the first process; start all "
        "with the same command",
        folder);
  }
  return std::unique_ptr<StreamWorker>(
      new StreamWorker(folder, std::make_unique<WindowTrainer>(std::move(trainer))));
}

Result<TrainedWindow> StreamWorker::train_window(const PreparedCapture& window, FrameSpan frames,
                                                 const ProgressSink& progress, const LogSink& log) {
  try {
    if (!trainer_->has_bounds()) {
      STGS_ASSIGN(const PreparedCapture first, read_prepared_capture(folder_));
      trainer_->take_bounds(first);
    }
    STGS_ASSIGN(const PersistentSet set, PersistentSet::read(set_path_of(folder_, frames.begin)));
    return trainer_->train(window, set, frames, progress, log, {});
  } catch (const std::exception& error) {
    return runtime_error("training a window after frame {} failed: {}", frames.begin, error.what());
  }
}

}  // namespace stgs::encoder
