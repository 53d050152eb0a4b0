// SPDX-License-Identifier: Apache-2.0
// The package: importing it defines <stgs-player>.
import { defineStgsPlayer } from "./element/stgs_player";
import type { QualitySettings } from "./player/adaptation";
import { PlayerError } from "./player/errors";
import { StgsPlayer } from "./player/player";
import type { PlayerOptions } from "./player/player";
import { chosenRenderer } from "./renderer_choice";
import { SegmentPlayer } from "./player/segment_player";
import type { RendererChoice } from "./renderer_choice";
import { createWorker, setResources } from "./resources";

/** Settings of createPlayer(). */
export interface CreatePlayerOptions extends QualitySettings, Pick<PlayerOptions, "lookAhead" | "audio" | "latency"> {
  /** Default: auto. */
  renderer?: RendererChoice;
}

/**
 * Creates a player that draws to a canvas without a context. The renderer is loaded meanwhile;
 * `activeRenderer` of the player states which one it is. If the browser has none, the player reports
 * an error.
 */
export function createPlayer(canvas: HTMLCanvasElement, options: CreatePlayerOptions = {}): StgsPlayer {
  const { renderer = "auto", ...others } = options;
  return new StgsPlayer({
    canvas, renderer: chosenRenderer(canvas, renderer), worker: createWorker, ...others,
  });
}

if (typeof customElements !== "undefined" && customElements.get("stgs-player") === undefined)
  defineStgsPlayer({ createWorker, createRenderer: chosenRenderer });

export { PlayerError, SegmentPlayer, StgsPlayer, createWorker, defineStgsPlayer, setResources };
export type { PlayerOptions, PlayerStats } from "./player/player";
export type { CameraView } from "./element/cameras/rig";
export type { StgsPlayerFactory } from "./element/factory";
export type { StgsPlayerElement } from "./element/stgs_player";
export type { ErrorReason } from "./player/errors";
export type { CameraSource } from "./player/frame_loop";
export type { Host, WorkerLike } from "./player/host";
export type { BufferedRanges } from "./player/ranges";
export type { Quality, QualityReport, QualitySettings } from "./player/adaptation";
export type { DeviceClass } from "./player/device";
export type { RendererChoice } from "./renderer_choice";
export type { Resources } from "./resources";
export type { ScenePlayer } from "./player/scene_player";
export type { SegmentPlayerOptions } from "./player/segment_player";
export type {
  Camera, LiveState, PackedSegment, PlayerNotice, Renderer, RendererStatistics, RenderView, SceneAudio, SceneInfo, SegmentSink, ViewRenderer,
} from "./types";
export type { XrMode, XrOptions } from "./xr/presenter";
