// SPDX-License-Identifier: Apache-2.0
// Chooses the work per window of a live capture, so that encoding keeps up with filming.
#pragma once

namespace stgs::encoder {

// The time of a stage: a fixed part and one in proportion to its amount of work. Their ratio is
// that of a reference machine; only the speed is learnt. The amounts of work vary too little to
// measure the two parts separately.
class WorkTime {
 public:
  // Seconds on the reference machine.
  WorkTime(double fixed, double each) : fixed_(fixed), each_(each) {}

  // Returns the amount of work that takes so many seconds; at least 0.
  double amount(double seconds) const;
  // Learns from an amount of work that took so many seconds.
  void learn(double amount, double seconds);
  // Learns from work without the fixed part: forgets all before.
  void set_each(double seconds) { slowness_ = seconds / each_; }

 private:
  double fixed_, each_;
  double slowness_ = 1;  // relative to the reference machine
};

// A window is prepared while the one before is trained. Each of the two may take as long as the
// window lasts, less a reserve; with a backlog, less time for more frames. Not thread-safe, except
// that keep() and wrote() may be called on another thread than the rest.
class LiveController {
 public:
  // `latency`: target from filming a frame to writing it, seconds. `iterations`: at most.
  LiveController(double fps, double latency, int iterations);

  // Returns the frames of a window that is encoded without a backlog.
  int window() const { return window_; }
  // Returns the frames of the next window, for which `ready` have arrived.
  int frames(int ready) const;
  // Return the work for a window of `frames`, while `waiting` more have arrived: every n-th frame
  // with dynamic points, and the iterations.
  int point_interval(int frames, int waiting) const;
  int iterations(int frames, int waiting) const;

  // Returns the fraction of the primitives of a window to keep.
  double keep() const { return keep_; }
  // Learns the bytes of a window that was written with this fraction. `kbps`: limit of the bit
  // rate, kbit/s. Returns false if even the smallest fraction exceeds it.
  bool wrote(int frames, double bytes, double kbps);

  // Learn the durations of a window that is not the first.
  void prepared(int frames, int point_interval, double seconds);
  void trained(int iterations, double seconds);
  // Learns the duration of the iterations alone of the first window, which has many.
  void first_trained(int iterations, double seconds);

 private:
  // Seconds that a stage may take for a window.
  double budget(int frames, int waiting) const;

  double fps_;
  int window_, max_iterations_;
  double keep_;
  WorkTime points_, steps_;  // of frames with points, and of iterations
};

}  // namespace stgs::encoder
