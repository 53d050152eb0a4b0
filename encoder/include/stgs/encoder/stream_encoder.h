// SPDX-License-Identifier: Apache-2.0
// Encodes a capture of any length, one window of time after the other.
//
// The first window trains all content of its frames. Its static content becomes the persistent set
// (persistent_set.h), which is stored once. A later window renders this set unchanged and trains
// only what it adds; static content that it uncovers joins the set, and content that is moved away
// leaves it. The rest is displayed until the capture ends. Memory is in proportion to a window, not
// to the capture.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "stgs/encoder/pack.h"
#include "stgs/encoder/persistent_set.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/encoder/train.h"
#include "stgs/format/scene_recorder.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct StreamSettings {
  // Of each window, without checkpoint, log and ranks. `target_size` must be 0: it limits a
  // complete file.
  TrainSettings train;
  double later_share = 0.5;  // iterations of a window after the first, as a fraction of its own
  // The profile, quality, tiers, chunk, position error and metadata of the file. Limits and targets
  // are those of `train`; `against` must be empty.
  PackSettings pack;
  std::string title;
  // Path of the recording, which players can follow while it grows; "": a file in the folder. It
  // must not exist when a run starts.
  std::string recording;
  bool carries_moving = false;  // see PersistentSet; not if it is resumable
  // Keep the persistent set in the folder after each window, and wait until windows are on disk, so
  // that a later process can resume. Otherwise the recording survives a crash of the process, but
  // not a power failure.
  bool resumable = true;
  // Describes everything else that the file depends on. A folder continues only an identical run.
  std::string identity;
};

// The work on a window; 0: that of the settings.
struct WindowWork {
  int iterations = 0;
  double max_seconds = 0;  // of training, to which its schedule adapts
  double keep = 0;         // fraction of the primitives that remain at its end (compact_keep)
};

// An encoded window.
struct StreamWindow {
  int first_frame = 0, frames = 0;
  TrainReport training;
  std::uint64_t primitives = 0;  // added to the file
  std::uint64_t persistent = 0;  // in the persistent set
  std::uint64_t ended = 0;       // no longer in it, because the images do not show them any more
  std::uint64_t bytes = 0;       // added to the file
};

// One thread at a time.
class StreamEncoder {
 public:
  // Starts in the folder, which exists and is empty, or resumes after the last complete window. The
  // folder holds the recording and the persistent set. Errors are those of check_training() and
  // check_packing(); kUsage if the folder belongs to another run or has other files, and for a
  // method without static primitives or the near-lossless profile.
  static Result<std::unique_ptr<StreamEncoder>> open(const std::string& folder,
                                                     const StreamSettings& settings);

  // Returns the number of encoded frames: the next window begins there.
  int frames() const;
  // Returns the number of primitives in the persistent set.
  std::uint64_t persistent() const { return set_.size(); }
  // Encodes the frames that follow. `window` is a prepared capture of these frames alone, with the
  // cameras of the first window, whose images may have another size. After an error or a
  // cancellation the recording ends with the previous window; after kIo it must be reopened.
  Result<StreamWindow> encode(const PreparedCapture& window, const ProgressSink& progress,
                              const LogSink& log, const WindowWork& work = {});
  // Extends the recording by frames with persistent content alone, for which there are no images.
  // kUsage before the first window; otherwise as encode().
  Status skip(int frames);
  // Continues after the last complete window of the recording, which an error has ended. kUsage
  // before the first window.
  Status reopen();
  // Marks the recording as finished, so that players play it to its end. Only finish() may follow.
  // kUsage before the first window.
  Status close();
  // Writes the finished file with its index at the front, atomically; it may replace the recording.
  // kUsage before the first window.
  Status finish(const std::string& output);
  // Removes the folder. Only the destructor may follow.
  void remove_files();

 private:
  StreamEncoder(std::string folder, StreamSettings settings)
      : folder_(std::move(folder)), settings_(std::move(settings)) {}

  // The bounds of the first window, which all windows are trained with.
  struct Bounds {
    float near_plane = 0, extent = 0;
    double radius = 0;
    double centre[3] = {0, 0, 0};
  };

  Result<StreamWindow> encode_window(PreparedCapture window, const ProgressSink& progress,
                                     const LogSink& log, const WindowWork& work);
  void take_bounds(const PreparedCapture& first);
  std::string recording_path() const {
    return settings_.recording.empty() ? folder_ + "/recording.stgs" : settings_.recording;
  }
  std::string set_path(int frames) const;
  RecordSettings record_settings() const;
  Status resume(const std::string& newest_set);
  Status create_recording(const Scene& scene);
  // Appends a trained window, of which `set` is the result.
  Status append(const Scene& scene, int frames, PersistentSet& set);

  std::string folder_;
  StreamSettings settings_;
  int later_iterations_ = 0;
  PersistentSet set_;
  std::shared_ptr<TrainBackend> backend_;    // null before the first window, and after an error
  std::optional<Bounds> bounds_;             // none before the first window
  std::unique_ptr<SceneRecorder> recorder_;  // null before the first window
};

}  // namespace stgs::encoder
