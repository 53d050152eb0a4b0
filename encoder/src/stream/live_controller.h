// SPDX-License-Identifier: Apache-2.0
// Chooses the work per window of a live capture, and the size of its images, so that encoding keeps
// up with filming.
#pragma once

namespace stgs::encoder {

// Images are halved at most so often.
inline constexpr int kMaxHalvings = 2;

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
  // Expects work to take so many times as long, until the next duration shows how long it takes.
  void expect(double factor) {
    slowness_ *= factor;
    is_expected_ = true;
  }

 private:
  double fixed_, each_;
  double slowness_ = 1;  // relative to the reference machine
  bool is_expected_ = false;
};

// A window is prepared while the one before is trained. Each of the two may take as long as the
// window lasts, less a reserve; with a backlog, less time for more frames. If even the least work
// takes longer, images become smaller. Not thread-safe, except that keep() and wrote() may be
// called on another thread than the rest.
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

  // Sets how often images may be halved; 0 before.
  void limit_halvings(int max) { max_halvings_ = max; }
  int max_halvings() const { return max_halvings_; }
  int halvings() const { return halvings_; }
  // Chooses how often the images of the next window are halved. `ready`: frames that have arrived.
  // `overflowed`: whether images were dropped because too many waited. Call it once per window.
  //
  // Images are halved after three windows in a row whose least work took too long, or after one if
  // images were dropped during the backlog. They are enlarged after ten windows in a row with
  // several times the least work and without a backlog; if that is soon too slow, the next time
  // after twice as many.
  int choose_halvings(int ready, bool overflowed);

  // Returns the fraction of the primitives of a window to keep.
  double keep() const { return keep_; }
  // Learns the bytes of a window that was written with this fraction. `kbps`: limit of the bit
  // rate, kbit/s. Returns false if even the smallest fraction exceeds it.
  bool wrote(int frames, double bytes, double kbps);

  // Learn the durations of a window that is not the first. `halvings`: of its images; a window of
  // another size than the next one teaches nothing.
  void prepared(int halvings, int frames, int point_interval, double seconds);
  void trained(int halvings, int frames, int iterations, double seconds);
  // Learns the duration of the iterations alone of the first window, which has many.
  void first_trained(int iterations, double seconds);

 private:
  // The speed of a stage.
  struct Stage {
    WorkTime time;
    int slow_windows = 0;    // in a row, whose least work took too long
    bool has_spare = false;  // the latest one had several times the least work, in time

    // Learns from a window, `window` seconds long, whose work was the least, or several times as
    // much, and took `seconds`.
    void rate(bool is_least, bool is_much, double seconds, double window);
    void change_size(double factor);
  };

  bool has_backlog(int frames, int waiting) const;
  // Seconds that a stage may take for a window.
  double budget(int frames, int waiting) const;
  void halve();
  void enlarge();
  // `factor`: by which the time of all work is expected to grow.
  void change_size(int halvings, double factor);

  double fps_;
  int window_, max_iterations_;
  double keep_;
  Stage points_, steps_;  // work: frames with points, and iterations
  int halvings_ = 0, max_halvings_ = 0;
  bool has_overflowed_ = false;  // since the size changed, or the latest calm window
  int calm_windows_ = 0;         // in a row
  int calm_required_;            // before images are enlarged
  int at_size_ = 0;              // windows since the size changed
  bool has_enlarged_ = false;    // by the latest change
};

}  // namespace stgs::encoder
