// SPDX-License-Identifier: Apache-2.0
// One seek, from the request to the frame of its time.
import { CoreMessage } from "../types";
import { Host } from "./host";

export type CoreState = Extract<CoreMessage, { type: "state" }>;

const MAX_WAIT = 250; // milliseconds that a newer target waits for the answer to an older one

/** Numbers of the targets that were sent: a state names the last one that the core had received. */
let lastId = 0;

/**
 * Sends a target to the core and recognises the answer: states from before the seek may still
 * arrive. While one target is in flight, later ones replace each other,
 * so that a slider that is dragged neither floods the core nor blocks until the last frame.
 */
export class Seek {
  private sent: { seconds: number; id: number; at: number } | null = null;
  private timer: number | null = null;
  private latest: number;

  constructor(
    target: number,
    private readonly host: Host,
    private readonly send: (seconds: number, id: number) => void,
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
  isAnswer(state: CoreState): boolean {
    return this.sent !== null && state.seek >= this.sent.id;
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
    this.sent = { seconds: this.latest, id: ++lastId, at: this.host.now() };
    this.send(this.latest, lastId);
  }
}
