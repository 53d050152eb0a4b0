// SPDX-License-Identifier: Apache-2.0
// Which moment is shown when: rates, pauses, loops.
#pragma once

namespace stgs::player {

// Moments in ticks of the clip, times in seconds of a clock that never goes back. Not thread-safe.
class PlaybackClock {
 public:
  // Shows moments in [0, last], the beginning of the last frame; frames last a tick. Infinity:
  // there is no end. ticks_a_second is what a rate of 1 is.
  PlaybackClock(double last, double ticks_a_second)
      : last_(last), ticks_a_second_(ticks_a_second) {}

  double ticks() const { return ticks_; }
  double rate() const { return rate_; }
  bool loop() const { return loop_; }
  double ticks_per_second() const { return rate_ * ticks_a_second_; }

  // The moment stays, also where that is the end of what there is now.
  void set_last(double last) { last_ = last; }
  void seek(double ticks);
  void set_rate(double rate) { rate_ = rate; }  // not 0
  void set_loop(bool loop) { loop_ = loop; }

  // Where the moment will be `seconds` later.
  struct Step {
    double ticks = 0;
    bool ended = false;   // it has come to the end, and stays there
    bool looped = false;  // it has gone round
  };
  Step after(double seconds) const;
  void apply(const Step& step) { ticks_ = step.ticks; }
  // Whether there is nothing left in the direction of play.
  bool at_end() const { return !loop_ && (rate_ < 0 ? ticks_ <= 0 : ticks_ >= last_); }

 private:
  double last_, ticks_a_second_;
  double ticks_ = 0, rate_ = 1;
  bool loop_ = false;
};

}  // namespace stgs::player
