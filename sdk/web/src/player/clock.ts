// SPDX-License-Identifier: Apache-2.0
// The playback time between two reports of the core.

const MAX_JITTER = 0.06; // seconds of difference that are adjusted slowly
const ADJUSTMENT = 0.1; // of a difference per report

/**
 * Extrapolates the time of the core, which reports it a few times per second.
 *
 * Times of the clip are in seconds, `now` and `at` in milliseconds of `Host.now`. While it runs,
 * the clock never goes back except where playback loops: if a report is behind the extrapolated
 * time, the clock holds its time until the report catches up.
 */
export class PlaybackClock {
  /** Seconds. */
  duration = 0;
  /** Seconds; the last frame begins this long before the end, where playback stops. */
  tick = 0;
  /** Whether playback continues at the other end of the clip. */
  loop = false;
  /** Whether both ends of the clip are buffered, so that a loop needs no report of the core. */
  canWrap = false;

  private base = 0;
  private at = 0;
  private rate = 1;
  private isRunning = false;
  private held: { seconds: number; until: number } | null = null;

  /** Whether the time advances. */
  get running(): boolean {
    return this.isRunning;
  }

  /** Moves to a time unconditionally: after a seek, or while paused. */
  jump(seconds: number, at: number, rate: number, running: boolean): void {
    this.base = seconds;
    this.at = at;
    this.rate = rate;
    this.isRunning = running;
    this.held = null;
  }

  /**
   * Takes over a report of the core during playback. The core reports its time after it has
   * decoded, so the report is late by a varying part of a frame: small differences are adjusted
   * slowly.
   */
  follow(seconds: number, at: number, rate: number, running: boolean, now: number): void {
    const before = this.time(now);
    const isAdvancing = this.isRunning && running && rate === this.rate;
    this.jump(seconds, at, rate, running);
    let behind = (before - this.estimate(now)) * Math.sign(rate);
    if (this.loop && this.duration > 0) {
      behind -= this.duration * Math.round(behind / this.duration);
    }
    if (isAdvancing && Math.abs(behind) < MAX_JITTER) {
      this.base = before - ADJUSTMENT * behind * Math.sign(rate);
      this.at = now;
      behind *= ADJUSTMENT;
    }
    if (behind > 0) {
      const wait = running ? (1000 * behind) / Math.abs(rate) : Infinity;
      this.held = { seconds: before, until: now + wait };
    }
  }

  /** Stops at the current time. */
  freeze(now: number): void {
    this.jump(this.time(now), now, this.rate, false);
  }

  /** Continues at another rate. */
  setRate(rate: number, now: number): void {
    this.jump(this.time(now), now, rate, this.isRunning);
  }

  /** The time of the last frame, seconds. */
  get last(): number {
    return Math.max(0, this.duration - this.tick);
  }

  /** Returns the time, from 0 to the last frame; below the duration in a loop. */
  time(now: number): number {
    if (this.held !== null && now < this.held.until) return this.held.seconds;
    return this.estimate(now);
  }

  private estimate(now: number): number {
    const passed = this.isRunning ? (this.rate * Math.max(0, now - this.at)) / 1000 : 0;
    const seconds = this.base + passed;
    if (this.isRunning && this.loop && this.canWrap && this.duration > 0) {
      const wrapped = seconds % this.duration;
      return wrapped < 0 ? wrapped + this.duration : wrapped;
    }
    return Math.min(Math.max(seconds, 0), this.last);
  }
}
