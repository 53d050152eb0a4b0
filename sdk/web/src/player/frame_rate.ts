// SPDX-License-Identifier: Apache-2.0

const WINDOW = 1000; // milliseconds over which frames are counted

/** The rate at which frames are completed, from samples of their number. */
export class FrameRate {
  private readonly samples: { time: number; completed: number }[] = []; // of the window, oldest first

  /** Adds a sample at `now`, milliseconds. A number below the last one is that of another renderer. */
  add(now: number, completed: number): void {
    const { samples } = this;
    if (samples.length > 0 && completed < samples[samples.length - 1]!.completed) samples.length = 0;
    samples.push({ time: now, completed });
    while (now - samples[0]!.time > WINDOW) samples.shift();
  }

  /** Frames completed in the last second. */
  get framesPerSecond(): number {
    const { samples } = this;
    return samples.length === 0 ? 0 : samples[samples.length - 1]!.completed - samples[0]!.completed;
  }
}
