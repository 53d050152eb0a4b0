// SPDX-License-Identifier: Apache-2.0
// The clock, frames and timers of the page, and the worker, as far as the player uses them.
import { CoreMessage, PageMessage } from "../types";

/** Clock, animation frames and timers. Tests pass their own. */
export interface Host {
  /** Milliseconds since the Unix epoch, monotonic: comparable with `at` of the core's states. */
  now(): number;
  requestFrame(callback: () => void): number;
  cancelFrame(id: number): void;
  setTimer(callback: () => void, milliseconds: number): number;
  clearTimer(id: number): void;
}

/** The part of a `Worker` that the player uses. */
export interface WorkerLike {
  postMessage(message: PageMessage): void;
  addEventListener(type: "message", listener: (event: { data: CoreMessage }) => void): void;
  addEventListener(type: "error", listener: (event: { message?: string }) => void): void;
  terminate(): void;
}

/** The host that belongs to the page. */
export function browserHost(): Host {
  return {
    now: () => performance.timeOrigin + performance.now(),
    requestFrame: (callback) => requestAnimationFrame(callback),
    cancelFrame: (id) => cancelAnimationFrame(id),
    setTimer: (callback, milliseconds) => window.setTimeout(callback, milliseconds),
    clearTimer: (id) => window.clearTimeout(id),
  };
}
