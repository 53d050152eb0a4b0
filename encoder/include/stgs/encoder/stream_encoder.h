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
#include <string>
#include <vector>

#include "stgs/encoder/pack.h"
#include "stgs/encoder/persistent_set.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/encoder/train.h"
#include "stgs/encoder/trained_window.h"
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
  std::uint64_t persistent = 0;  // in the persistent set, after the round of the window
  std::uint64_t ended = 0;       // that its images do not show any more
  std::uint64_t bytes = 0;       // added to the file
};

class WindowTrainer;
struct WindowPlan;

// One thread at a time.
class StreamEncoder {
 public:
  // Starts in the folder, which exists and is empty, or resumes after the last complete window. The
  // folder holds the recording and the persistent set. Errors are those of check_training() and
  // check_packing(); kUsage if the folder belongs to another run or has other files, and for a
  // method without static primitives or the near-lossless profile.
  static Result<std::unique_ptr<StreamEncoder>> open(const std::string& folder,
                                                     const StreamSettings& settings);
  ~StreamEncoder();

  // Returns the number of encoded frames: the next window begins there.
  int frames() const;
  // Returns the number of primitives in the persistent set.
  std::uint64_t persistent() const { return set_.size(); }
  // Encodes the frames that follow. `window` is a prepared capture of these frames alone, with the
  // cameras of the first window, whose images may have another size. After an error or a
  // cancellation the recording ends with the previous window; after kIo it must be reopened.
  Result<StreamWindow> encode(const PreparedCapture& window, const ProgressSink& progress,
                              const LogSink& log, const WindowWork& work = {});

  // Several processes train the windows of a round, against the same set: the window that follows
  // here, later ones with a StreamWorker. Then append() records all of them.

  // Trains the frames that follow, as encode(), without recording them.
  Result<TrainedWindow> train_window(const PreparedCapture& window, const ProgressSink& progress,
                                     const LogSink& log, const WindowWork& work = {});
  // Records the windows of a round, at least one, in order. Each is displayed as it was trained.
  // The set of the last one becomes the persistent set. After an error in a round of several
  // windows, open() the folder again, which continues before the round.
  Result<std::vector<StreamWindow>> append(std::vector<TrainedWindow> round);

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
  StreamEncoder(std::string folder, StreamSettings settings);

  std::string recording_path() const {
    return settings_.recording.empty() ? folder_ + "/recording.stgs" : settings_.recording;
  }
  RecordSettings record_settings() const;
  Status resume(const std::string& newest_set);
  Status create_recording(const Scene& scene);
  Result<std::vector<StreamWindow>> append_round(std::vector<TrainedWindow> round);
  // kInvalidFile if the windows do not fit each other and the set. `ends`: those of each window.
  Status check_round(const std::vector<TrainedWindow>& round,
                     const std::vector<std::vector<MemberEnd>>& ends) const;
  // Appends a window. `members`: where those of the set are stored. `added`: of the last window,
  // where its additions are.
  Status record(const TrainedWindow& window, const WindowPlan& plan, bool is_last,
                std::vector<StoredPrimitive>& members, std::vector<StoredPrimitive>& added);

  std::string folder_;
  StreamSettings settings_;
  std::unique_ptr<WindowTrainer> trainer_;
  PersistentSet set_;
  std::unique_ptr<SceneRecorder> recorder_;  // null before the first window
};

}  // namespace stgs::encoder
