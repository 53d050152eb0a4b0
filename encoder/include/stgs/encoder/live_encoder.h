// SPDX-License-Identifier: Apache-2.0
// Encodes a rig while it films: frames in, a growing .stgs file out.
//
// Frames are collected into windows whose length is a third of the target latency. While one window
// is trained, another thread prepares the next (stream_encoder.h). The work per window is chosen by
// the durations of the previous ones. On a machine that is too slow, windows become longer and
// their images smaller, and frames are dropped once too many wait.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "stgs/encoder/live_preparer.h"
#include "stgs/encoder/stream_encoder.h"
#include "stgs/format/parameter.h"
#include "stgs/format/task_runner.h"

namespace stgs::encoder {

class LiveController;
class LiveQueue;

struct LiveSettings {
  // `recording` is required; identity is ignored. A window has at most the iterations of `train`,
  // whose limits of size and rate must be 0.
  StreamSettings stream;
  double latency = 1.5;  // target from filming a frame to its fragment, seconds
  // Limit of the mean bit rate once static content is stored, kbit/s; 0: none. A tenth of the
  // primitives of a window remains in any case.
  double target_kbps = 0;
  double first_seconds = 3;  // of training for the first window, whose static content stays
  // Wait for all cameras after the first image; then it starts with those that deliver.
  double start_seconds = 10;
  std::uint64_t queue_bytes = 0;  // of frames that wait; 0: a quarter of the available memory
  TaskRunner* tasks = nullptr;    // of both threads, outlives the encoder; null: the default pool
};

inline constexpr Parameter kLiveKbps = {
    "target_kbps", 1,         1e9, "Limit of the mean bit rate once static content is stored",
    "kbit/s",      "no limit"};
inline constexpr Parameter kLiveLatency = {"latency", 0.1, 60,
                                           "Target from filming a frame to writing it", "seconds"};

// A window that was written or lost.
struct LiveWindow {
  int first_frame = 0, frames = 0;
  std::uint64_t missing = 0;  // images of cameras that take part, not delivered in time
  double scale = 1;           // of its images, relative to those of the preparer: 1, 0.5 or 0.25
  int point_interval = 1, iterations = 0;
  std::uint64_t primitives = 0, persistent = 0, bytes = 0;  // as in StreamWindow
  double loss = 0;                                          // of training
  // Of images that training has seen, at its end, dB (TrainReport::psnr); 0: it had no step.
  double psnr = 0;
  double prepare_seconds = 0, train_seconds = 0;  // with writing
  double step_seconds = 0;                        // of the iterations, in train_seconds
  double latency = 0;   // of the frame that waited longest since its last image arrived, seconds
  int waiting = 0;      // frames that wait
  bool written = true;  // false: the disk or the preparation failed; it shows static content alone
};

// Totals.
struct LiveReport {
  int cameras = 0;                                                             // that take part
  std::uint64_t received = 0;                                                  // images
  std::uint64_t dropped = 0, late = 0, repeated = 0, ahead = 0, overflow = 0;  // of them
  std::uint64_t missing = 0;  // images of cameras that take part, not delivered in time
  int frames = 0, windows = 0, lost_frames = 0;  // lost: of windows that were not written
  std::uint64_t primitives = 0, persistent = 0, bytes = 0;
  double psnr = 0;   // mean of those of the windows, per frame, dB; 0: none has one
  double scale = 0;  // mean of those of the windows, per frame; 0: no window
  double latency_median = 0, latency_p95 = 0, latency_max = 0;  // per frame, seconds
};

// Called after each window, on a thread of the encoder.
using LiveWindowSink = std::function<void(const LiveWindow&)>;

class LiveEncoder {
 public:
  // Starts two threads, which wait for frames, and call `windows` and `log`. `folder` is a new or
  // empty folder for the state of the run; the recording must not exist. The preparer must outlive
  // the object and serves it alone, except for convert() and read_source(). Errors as
  // StreamEncoder::open().
  static Result<std::unique_ptr<LiveEncoder>> open(LivePreparer& preparer,
                                                   const std::string& folder,
                                                   const LiveSettings& settings,
                                                   LiveWindowSink windows, LogSink log);
  // Stops as stop().
  ~LiveEncoder();
  LiveEncoder(const LiveEncoder&) = delete;
  LiveEncoder& operator=(const LiveEncoder&) = delete;

  // Adds a prepared frame (LivePreparer::convert()). `seconds`: of the common clock of the cameras.
  // Never waits for encoding. Thread-safe, like end_camera().
  void push(std::size_t camera, double seconds, Image8 frame);
  // Ends a camera: nothing more is pushed for it.
  void end_camera(std::size_t camera);
  // Returns whether encoding has ended: all cameras have ended, or there was an error. Thread-safe.
  bool ended() const;
  // Returns the totals so far. Thread-safe.
  LiveReport report() const;

  // Stops without encoding the frames that wait. The recording remains. Only report() may follow.
  void stop();
  // Ends all cameras, encodes the frames that wait and marks the recording as finished, so that
  // players play it to its end. Then writes the file with its index at the front to `output`,
  // unless it is ""; if it is the recording, players have to open it again. Returns the error that
  // ended the encoding, if any: then the recording remains as it is. Nothing may be pushed
  // afterwards.
  Status finish(const std::string& output);

 private:
  // A window that is handed from the preparing to the training thread.
  struct Prepared {
    PreparedCapture capture;
    int halvings = 0;  // of its images
    LiveWindow window;
    std::vector<double> arrived;  // per frame
    Status status;                // of the preparation
  };

  LiveEncoder(LivePreparer& preparer, std::string folder, LiveSettings settings,
              LiveWindowSink windows, LogSink log);
  double now() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begun_).count();
  }
  void prepare_windows();
  Status prepare_all();
  Result<bool> prepare_next(int index);
  // Returns whether images were dropped since the last call, because too many waited.
  bool log_overflow();
  // Returns how often the images of the window that begins with this frame are halved.
  int choose_halvings(int first_frame, int ready, bool overflowed);
  // Prepares a window, on which work began at `begin`, while `waiting` more frames have arrived.
  void prepare(Prepared& prepared, bool is_first, double begin, int waiting);
  void train_windows();
  Status train_all();
  Status train(Prepared& prepared);
  Status write(Prepared& prepared);
  // Reopens the recording after lost windows, and covers their time with static content.
  Status recover();
  void count(const Prepared& prepared);
  // Learns the bytes of a window that was written. On the training thread.
  void follow_rate(const LiveWindow& window);
  void fail(const Status& status);

  LivePreparer& preparer_;
  const std::string folder_;
  LiveSettings settings_;
  const LiveWindowSink windows_;
  const LogSink log_;
  const std::chrono::steady_clock::time_point begun_ = std::chrono::steady_clock::now();
  std::unique_ptr<StreamEncoder> encoder_;
  std::unique_ptr<LiveQueue> queue_;
  std::unique_ptr<LiveController> controller_;
  PreparedCapture rig_;                   // without frames; of the preparing thread
  std::vector<std::size_t> taking_part_;  // cameras of rig_, as indices of the preparer
  int lost_ = 0;                          // frames that the file does not cover yet
  bool has_first_ = false;                // the first window is written
  bool keeps_chosen_ = false;             // the settings state how many primitives remain
  bool is_over_rate_ = false;             // it was logged
  int failures_ = 0;                      // windows in a row that were not written
  std::uint64_t overflow_ = 0;            // that was logged

  mutable std::mutex mutex_;  // of everything below
  std::condition_variable handed_;
  std::optional<Prepared> next_;
  bool prepared_all_ = false, trained_all_ = false, stopped_ = false;
  Status error_;
  LiveReport report_;
  int measured_frames_ = 0;               // of windows with a PSNR
  std::vector<std::uint32_t> latencies_;  // frames, by milliseconds
  std::thread preparing_, training_;      // last: they use the members above
};

}  // namespace stgs::encoder
