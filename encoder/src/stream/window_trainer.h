// SPDX-License-Identifier: Apache-2.0
// Trains windows of a long capture, in one of the processes that encode it.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "stgs/encoder/prepare.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/stream_encoder.h"
#include "stgs/encoder/trained_window.h"

namespace stgs::encoder {

// Paths in the folder of a run: of the persistent set after a number of frames, and of the
// description of the run.
std::string set_path_of(const std::string& folder, int frames);
std::string identity_path_of(const std::string& folder);

class WindowTrainer {
 public:
  // Errors are those of StreamEncoder::open() that the settings cause.
  static Result<WindowTrainer> create(const StreamSettings& settings);

  // Returns a description of everything that the file depends on.
  const std::string& identity() const { return identity_; }
  // Returns whether a folder holds an identical run.
  Result<bool> is_run_of(const std::string& folder) const;

  // The bounds of the first window, which all windows are trained with.
  bool has_bounds() const { return bounds_.has_value(); }
  void take_bounds(const PreparedCapture& first);

  // Trains a window against a set that is unchanged. `frames`: from the end of the recording that
  // the set is of to the end of the window. take_bounds() must have been called.
  Result<TrainedWindow> train(PreparedCapture window, const PersistentSet& set, FrameSpan frames,
                              const ProgressSink& progress, const LogSink& log,
                              const WindowWork& work);

 private:
  struct Bounds {
    float near_plane = 0, extent = 0;
    double radius = 0;
    double centre[3] = {0, 0, 0};
  };

  explicit WindowTrainer(TrainSettings settings) : settings_(std::move(settings)) {}
  TrainSettings settings_for(int frames, const WindowWork& work) const;

  TrainSettings settings_;
  std::string identity_;
  int later_iterations_ = 0;
  std::shared_ptr<TrainBackend> backend_;  // null before the first window, and after an error
  std::optional<Bounds> bounds_;
};

}  // namespace stgs::encoder
