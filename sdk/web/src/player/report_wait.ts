// SPDX-License-Identifier: Apache-2.0
import { Host } from "./host";

/** Milliseconds in which the core reports a change. */
const REPORT_TIME = 400;

/**
 * Waits for a report that the core need not send. While paused, it may not report that the last
 * segment has arrived; then its latest report counts as it is.
 */
export class ReportWait {
  /** Whether the wait ended without the report. */
  expired = false;
  private timer: number | null = null;

  constructor(private readonly host: Host, private readonly onExpired: () => void) {}

  /** Starts to wait, unless it does already. */
  start(): void {
    this.timer ??= this.host.setTimer(() => {
      this.timer = null;
      this.expired = true;
      this.onExpired();
    }, REPORT_TIME);
  }

  /** A segment arrived: another one may follow before the core reports. */
  extend(): void {
    if (this.timer === null && !this.expired) return;
    this.reset();
    this.start();
  }

  /** Ends the wait: the report arrived, or another one is expected. */
  reset(): void {
    this.expired = false;
    if (this.timer !== null) this.host.clearTimer(this.timer);
    this.timer = null;
  }
}
