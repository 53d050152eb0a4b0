// SPDX-License-Identifier: Apache-2.0
import { PlayerStats } from "../player/player";
import { BufferedRanges } from "../player/ranges";
import { LiveState, SceneInfo } from "../types";
import type { XrMode } from "../xr/presenter";

/** The part of the element that its controls use. Dispatches the events of the player. */
export interface Media extends EventTarget {
  readonly paused: boolean;
  readonly ended: boolean;
  readonly seeking: boolean;
  readonly hasSource: boolean;
  readonly duration: number;
  readonly readyState: number;
  readonly buffered: BufferedRanges;
  readonly stats: PlayerStats;
  readonly activeRenderer: "webgl2" | "webgpu" | null;
  readonly info: SceneInfo | null;
  readonly live: LiveState | null;
  readonly error: { message: string } | null;
  readonly videoWidth: number;
  readonly videoHeight: number;
  currentTime: number;
  playbackRate: number;
  loop: boolean;
  muted: boolean;
  readonly hasAudio: boolean;
  readonly isInXR: boolean;
  play(): Promise<void>;
  pause(): void;
  goLive(): void;
  supportsXR(mode: XrMode): Promise<boolean>;
  enterXR(mode: XrMode): Promise<void>;
  exitXR(): Promise<void>;
}

/** Plays or pauses. */
export function toggle(media: Media): void {
  if (media.paused) media.play().catch(() => undefined); // the error event reports failures
  else media.pause();
}
