// SPDX-License-Identifier: Apache-2.0
// The playback position over time: rate, pauses, loops.
#pragma once

namespace stgs::player {

// Positions are ticks of the clip, times are seconds of a monotonic clock. Not thread-safe.
class PlaybackClock {
 public:
  // Positions lie in [0, last]; `last` is the beginning of the last frame, or infinity for an open
  // end. Frames last one tick. `ticks_per_second_at_1` is the speed at a rate of 1.
  PlaybackClock(double last, double ticks_per_second_at_1)
      : last_(last), ticks_per_second_at_1_(ticks_per_second_at_1) {}

  double ticks() const { return ticks_; }
  double rate() const { return rate_; }
  bool loop() const { return loop_; }
  double ticks_per_second() const { return rate_ * ticks_per_second_at_1_; }

  // Sets the end. The position is unchanged, even if it is past the end.
  void set_last(double last) { last_ = last; }
  void seek(double ticks);
  void set_rate(double rate) { rate_ = rate; }  // not 0
  void set_loop(bool loop) { loop_ = loop; }

  // A change of position.
  struct Step {
    double ticks = 0;
    bool ended = false;   // reached the end and stays there
    bool looped = false;  // wrapped around
  };
  // Returns the position after `seconds` of playback, without moving to it.
  Step after(double seconds) const;
  // Moves to the position of a step.
  void apply(const Step& step) { ticks_ = step.ticks; }
  // Returns whether the position is at the end in the direction of playback.
  bool at_end() const { return !loop_ && (rate_ < 0 ? ticks_ <= 0 : ticks_ >= last_); }

 private:
  double last_, ticks_per_second_at_1_;
  double ticks_ = 0, rate_ = 1;
  bool loop_ = false;
};

}  // namespace stgs::player
