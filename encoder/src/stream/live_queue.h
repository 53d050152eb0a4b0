// SPDX-License-Identifier: Apache-2.0
// Sorts the frames that cameras deliver into the frames of a live capture.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// The images of one frame of the capture.
struct LiveFrame {
  std::vector<std::shared_ptr<const Image8>> images;  // per camera; null: none
  double arrived = 0;                                 // the latest of them, seconds of now()
};

struct LiveFrames {
  int first = 0;  // number of the first one
  std::vector<LiveFrame> frames;
  int waiting = 0;  // complete frames that are left in the queue
};

// Images that were delivered but are not encoded, by reason.
struct LiveDropped {
  std::uint64_t late = 0;      // their frame had been taken
  std::uint64_t repeated = 0;  // of a frame that the camera had delivered
  std::uint64_t ahead = 0;     // too far ahead of the present, or without a time
  std::uint64_t overflow = 0;  // too many frames waited
  std::uint64_t total() const { return late + repeated + ahead + overflow; }
};

// Frame n of the capture is at n / fps seconds after the first. The first one has images of all
// cameras that take part; images before it are not counted. A frame is complete when each of these
// cameras has delivered it, a later frame, or nothing for the grace time. While no camera delivers
// anything, time passes without images; a pause longer than kMaxPauseSeconds is shortened to it.
// Thread-safe.
class LiveQueue {
 public:
  // The grace time is this, or two frames if they take longer.
  static constexpr double kGraceSeconds = 0.25;
  static constexpr double kMaxAheadSeconds = 5;  // of the present, or of another camera
  static constexpr double kMaxPauseSeconds = 600;
  static constexpr double kMaxWaitingSeconds = 20;  // frames of all cameras that wait

  // `max_bytes`: of the images that wait. There are at most those of kMaxWaitingSeconds, too: a
  // machine that is too slow drops frames instead of falling behind.
  LiveQueue(std::size_t cameras, double fps, std::uint64_t max_bytes);

  // Adds an image. `seconds`: of the clock of the cameras. `now`: of a monotonic clock.
  void push(std::size_t camera, double seconds, std::shared_ptr<const Image8> image, double now);
  // The camera delivers no more.
  void end(std::size_t camera);
  // Ends all of them.
  void end_all();

  // Waits until a frame has images of all cameras that have not ended, or until `wait` seconds
  // after the first image; then the latest frame with most images of at least two cameras begins
  // the capture, and these cameras take part. Returns which do; none if too few have delivered
  // anything when all have ended. Until then, the memory holds the latest images.
  std::vector<bool> start(double wait, const std::function<double()>& now);
  // Waits for `min` complete frames and returns up to `max`; fewer at the end, and if the memory
  // cannot hold them; none after the end.
  LiveFrames take(int min, int max, const std::function<double()>& now);
  // Returns the number of complete frames.
  int ready(double now) const;

  LiveDropped dropped() const;
  // Returns the number of images that arrived.
  std::uint64_t received() const;

 private:
  struct CameraState {
    bool takes_part = true, ended = false;
    std::int64_t latest = -1;  // slot
    double arrived = 0;
  };

  // Returns the slot of an image, or -1 for an image that is dropped, which is counted.
  std::int64_t accept(std::size_t camera, double seconds, double now);
  bool fits(std::size_t bytes) const;
  void drop_first();
  int complete(double now) const;
  bool all_ended() const;

  const double fps_, grace_;
  const std::size_t max_images_;
  const std::uint64_t max_bytes_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<CameraState> cameras_;
  std::optional<double> origin_;  // time of slot 0
  double origin_now_ = 0;         // when it arrived
  std::deque<LiveFrame> slots_;   // from first_slot_
  std::int64_t first_slot_ = 0;
  std::int64_t start_slot_ = 0;  // that is frame 0 of the capture
  bool started_ = false, is_full_ = false;
  std::uint64_t bytes_ = 0, received_ = 0;
  std::size_t images_ = 0;  // that wait
  LiveDropped dropped_;
};

}  // namespace stgs::encoder
