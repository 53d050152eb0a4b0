// SPDX-License-Identifier: Apache-2.0
import { kCountWord, kDrawnWords } from "./radix_sort";
import { BUFFER_USAGE, MAP_MODE_READ } from "./webgpu_types";
import type {
  GPUBuffer, GPUCommandEncoder, GPUDevice, GPUQuerySet, GPUTimestampWrites,
} from "./webgpu_types";

/** The measurements of a frame on the GPU. Times are null if the GPU has no timestamps. */
export interface FrameFigures {
  /** Visible splats of the last view. */
  visible: number;
  /** Milliseconds of evaluation, culling, projection and SH; of the sorts; of rasterisation. */
  projectMs: number | null;
  sortMs: number | null;
  rasterMs: number | null;
}

const kTimesOffset = 4 * kDrawnWords;

/** Number of timestamps of a frame: the start and end of each stage (timesOf()). */
function timesOfViews(views: number): number {
  return 2 * (1 + 2 * views);
}

/** Reads the figures of frames back, one frame at a time; those in between are not read. */
export class FrameReport {
  private readonly queries: GPUQuerySet | null;
  private readonly resolved: GPUBuffer | null;
  private readonly copy: GPUBuffer;
  private inFlight = false;

  /** `views`: maximum number of views per frame. */
  constructor(device: GPUDevice, views: number) {
    const { COPY_SRC, COPY_DST, MAP_READ, QUERY_RESOLVE } = BUFFER_USAGE;
    const timed = device.features.has("timestamp-query");
    const count = timesOfViews(views);
    this.queries = timed ? device.createQuerySet({ type: "timestamp", count }) : null;
    this.resolved = timed
      ? device.createBuffer({ size: 8 * count, usage: QUERY_RESOLVE | COPY_SRC })
      : null;
    this.copy = device.createBuffer(
      { size: kTimesOffset + 8 * count, usage: MAP_READ | COPY_DST });
  }

  /**
   * The `timestampWrites` of the pass of a stage: 0 for the projection; for view k, 1 + 2k for the sort and
   * 2 + 2k for rasterisation.
   */
  timesOf(stage: number): { timestampWrites?: GPUTimestampWrites } {
    if (this.queries === null) return {};
    return {
      timestampWrites: {
        querySet: this.queries,
        beginningOfPassWriteIndex: 2 * stage,
        endOfPassWriteIndex: 2 * stage + 1,
      },
    };
  }

  /**
   * Encodes the copy of a frame's figures, after its passes. Returns a function to be called after
   * the commands are submitted, which passes the figures to `receive`; null if an earlier frame is
   * still being read. `views`: those of the frame.
   */
  encode(
    encoder: GPUCommandEncoder, drawn: GPUBuffer, views: number,
    receive: (figures: FrameFigures) => void,
  ): (() => void) | null {
    if (this.inFlight) return null;
    encoder.copyBufferToBuffer(drawn, 0, this.copy, 0, kTimesOffset);
    if (this.queries !== null && this.resolved !== null) {
      // Only the timestamps that the frame writes: some implementations wait for the others.
      const count = timesOfViews(views);
      encoder.resolveQuerySet(this.queries, 0, count, this.resolved, 0);
      encoder.copyBufferToBuffer(this.resolved, 0, this.copy, kTimesOffset, 8 * count);
    }
    this.inFlight = true;
    return () => {
      this.copy.mapAsync(MAP_MODE_READ).then(
        () => {
          const figures = this.figuresOf(this.copy.getMappedRange(), views);
          this.copy.unmap();
          this.inFlight = false;
          receive(figures);
        },
        () => undefined, // the device was lost or destroyed, which is reported elsewhere
      );
    };
  }

  destroy(): void {
    this.queries?.destroy();
    this.resolved?.destroy();
    this.copy.destroy();
  }

  private figuresOf(bytes: ArrayBuffer, views: number): FrameFigures {
    const visible = new Uint32Array(bytes)[kCountWord] as number;
    if (this.queries === null) return { visible, projectMs: null, sortMs: null, rasterMs: null };
    const times = new BigInt64Array(bytes, kTimesOffset);
    const stage = (k: number) => {
      const nanoseconds = (times[2 * k + 1] as bigint) - (times[2 * k] as bigint);
      return Math.max(0, Number(nanoseconds)) / 1e6;
    };
    let sortMs = 0;
    let rasterMs = 0;
    for (let k = 0; k < views; ++k) {
      sortMs += stage(1 + 2 * k);
      rasterMs += stage(2 + 2 * k);
    }
    return { visible, projectMs: stage(0), sortMs, rasterMs };
  }
}
