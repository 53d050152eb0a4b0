// SPDX-License-Identifier: Apache-2.0
// The latency of a player behind the live edge of a recording.

/** Seconds. */
export const DEFAULT_LATENCY = 1, MAX_LATENCY = 3600;

/** Whether a number of seconds can be the latency of a player. */
export function isLatency(seconds: number): boolean {
  return seconds >= 0 && seconds <= MAX_LATENCY;
}

/** Returns a latency. Throws an IndexSizeError unless it is from 0 to 3600. */
export function checkLatency(seconds: number): number {
  if (!isLatency(seconds))
    throw new DOMException(`latency ${seconds} is out of range (expected 0 to ${MAX_LATENCY} seconds)`, "IndexSizeError");
  return seconds;
}
