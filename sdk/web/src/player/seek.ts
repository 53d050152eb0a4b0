// SPDX-License-Identifier: Apache-2.0
// One seek, from the request to the frame of its time.
import { CoreMessage } from "../types";
import { Host } from "./host";

export type CoreState = Extract<CoreMessage, { type: "state" }>;

const MAX_WAIT = 250; // milliseconds that a newer target waits for the answer to an older one
const CLOCK_SLACK = 5; // milliseconds between the clocks of the page and of the worker
const MIN_TOLERANCE = 0.05; // seconds; the core moves to a tick and may have advanced since
const ACCEPT_AFTER = 1000; // milliseconds after which the core's time counts as the answer

/** The clip, as far as a seek depends on it. Seconds. */
export interface SeekContext {
  tickSeconds: number;
  duration: number;
  loop: boolean;
}

/**
 * Sends a target to the core and recognises the answer: states have no number, and those from
 * before the seek may still arrive. While one target is in flight, later ones replace each other,
 * so that a slider that is dragged neither floods the core nor blocks until the last frame.
 */
export class Seek {
  private sent: { seconds: number; at: number } | null = null;
  private timer: number | null = null;
  private latest: number;

  constructor(
    target: number,
    private readonly host: Host,
    private readonly send: (seconds: number) => void,
  ) {
    this.latest = target;
  }

  /** The latest target, seconds. */
  get target(): number {
    return this.latest;
  }

  set target(seconds: number) {
    this.latest = seconds;
    this.flush();
  }

  /** Sends the latest target unless an earlier one is in flight. */
  flush(): void {
    if (this.sent === null) return this.post();
    if (this.sent.seconds === this.latest || this.timer !== null) return;
    const wait = MAX_WAIT - (this.host.now() - this.sent.at);
    this.timer = this.host.setTimer(() => {
      this.timer = null;
      if (this.sent?.seconds !== this.latest) this.post();
    }, Math.max(0, wait));
  }

  /** Whether `state` is the core's answer to the target in flight. */
  isAnswer(state: CoreState, context: SeekContext): boolean {
    if (this.sent === null) return false;
    const passed = state.at - this.sent.at;
    if (passed < -CLOCK_SLACK) return false;
    if (passed > ACCEPT_AFTER) return true;
    const tolerance = Math.max(MIN_TOLERANCE, 2 * context.tickSeconds);
    const advance = (state.rate * Math.max(0, passed)) / 1000;
    let off = state.seconds - this.sent.seconds;
    if (context.loop && context.duration > 0) {
      off -= context.duration * Math.round(off / context.duration);
    }
    return off >= Math.min(0, advance) - tolerance && off <= Math.max(0, advance) + tolerance;
  }

  /** The data of the target in flight is available. Returns whether it was the latest target. */
  finish(): boolean {
    if (this.sent?.seconds === this.latest) {
      this.cancel();
      return true;
    }
    this.post();
    return false;
  }

  /** Ends the seek; nothing is sent any more. */
  cancel(): void {
    if (this.timer !== null) this.host.clearTimer(this.timer);
    this.timer = null;
  }

  private post(): void {
    this.cancel();
    this.sent = { seconds: this.latest, at: this.host.now() };
    this.send(this.latest);
  }
}
