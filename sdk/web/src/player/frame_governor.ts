// SPDX-License-Identifier: Apache-2.0
// Judges whether frames are on time. Times are in milliseconds of a monotonic clock.

const WINDOW = 1000; // over which frames are counted
const MAX_GAP = 1000; // between two frames; the page may be hidden during a longer gap
const LATE_WINDOWS = 2; // in a row, before the load is lowered
const ON_TIME = 0.9; // of the target
const HEADROOM = 1.6; // of the target: a larger load is then likely to be on time as well
const MIN_CALM = 5, MAX_CALM = 160; // windows on time before the load is raised
const WITHOUT_HEADROOM = 4; // factor of the above without headroom

/** A change of the load. */
export type Verdict = "lower" | "raise" | null;

/**
 * Judges the frame rate during continuous drawing. It lowers the load quickly and raises it slowly: each
 * attempt to raise it that makes frames late doubles the wait before the next attempt.
 */
export class FrameGovernor {
  /** The rate in the last complete window; null before that. */
  framesPerSecond: number | null = null;
  private window: { begin: number; completed: number; last: number } | null = null;
  private gaps = 0; // long ones in a row
  private late = 0; // windows in a row
  private inTime = 0; // windows in a row
  private calm = MIN_CALM;
  private isTrying = false; // the load was raised recently

  /** `target`: frames per second. */
  constructor(private readonly target: number) {}

  /**
   * Counts a frame. `completed`: number of frames finished so far; `canRaise`: whether the load can be
   * raised.
   */
  frame(now: number, completed: number, canRaise: boolean): Verdict {
    const { window } = this;
    const gap = window === null ? 0 : now - window.last;
    this.gaps = gap > MAX_GAP ? this.gaps + 1 : 0;
    if (window === null || this.gaps === 1) return this.begin(now, completed);
    window.last = now;
    if (now - window.begin < WINDOW) return null;
    this.framesPerSecond = (1000 * (completed - window.completed)) / (now - window.begin);
    this.begin(now, completed);
    if (this.framesPerSecond < ON_TIME * this.target) return this.countLate();
    return this.countInTime(this.framesPerSecond, canRaise);
  }

  /** Ignores the time until the next frame, because drawing has paused. */
  pause(): void {
    this.window = null;
    this.gaps = 0;
  }

  private begin(now: number, completed: number): null {
    this.window = { begin: now, completed, last: now };
    return null;
  }

  private countLate(): Verdict {
    this.inTime = 0;
    if (++this.late < LATE_WINDOWS) return null;
    this.late = 0;
    if (this.isTrying) this.calm = Math.min(2 * this.calm, MAX_CALM);
    this.isTrying = false;
    return "lower";
  }

  private countInTime(rate: number, canRaise: boolean): Verdict {
    this.late = 0;
    ++this.inTime;
    if (this.inTime >= this.calm) this.isTrying = false;
    const needed = rate >= HEADROOM * this.target ? this.calm : Math.min(WITHOUT_HEADROOM * this.calm, MAX_CALM);
    if (!canRaise || this.inTime < needed) return null;
    this.inTime = 0;
    this.isTrying = true;
    return "raise";
  }
}
