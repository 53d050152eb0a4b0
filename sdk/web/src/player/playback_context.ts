// SPDX-License-Identifier: Apache-2.0
import { OpenOptions, SceneInfo, SegmentSink } from "../types";
import { EventQueue } from "./event_queue";
import { Host } from "./host";
import { WorkerSource } from "./worker_link";

/** Values of `readyState`, as those of media elements. */
export const enum Ready {
  Nothing = 0,
  Metadata = 1,
  CurrentData = 2,
  EnoughData = 4,
}

/** Parts that playback works with; they belong to the caller. */
export interface PlaybackContext {
  worker: WorkerSource;
  renderer: SegmentSink;
  host: Host;
  events: EventQueue;
  /** Of the next source. */
  options(): OpenOptions;
  onOpened(info: SceneInfo): void;
  /** `SceneInfo.tierPrimitives`, as far as known now. */
  onTiers(tierPrimitives: readonly number[]): void;
  /** The time may have changed. */
  onTime(): void;
  /** The image at the current time has changed. */
  onContent(): void;
}
