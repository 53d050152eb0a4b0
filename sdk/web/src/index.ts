// SPDX-License-Identifier: Apache-2.0
// The package: importing it defines <stgs-player>.
import { defineStgsPlayer } from "./element/stgs_player";
import { StgsPlayer } from "./player/player";
import type { PlayerOptions } from "./player/player";
import { createWorker, sorterUrl } from "./resources";
import { createWebGl2Renderer } from "./webgl2";

/** Creates a player that draws to a canvas. Throws if the browser has no WebGL2. */
export function createPlayer(canvas: HTMLCanvasElement,
                             options: Pick<PlayerOptions, "memoryBudget" | "lookAhead"> = {}): StgsPlayer {
  return new StgsPlayer({ canvas, renderer: createRenderer(canvas), worker: createWorker, ...options });
}

function createRenderer(canvas: HTMLCanvasElement) {
  return createWebGl2Renderer(canvas, { sorterUrl: sorterUrl() });
}

if (typeof customElements !== "undefined" && customElements.get("stgs-player") === undefined)
  defineStgsPlayer({ createWorker, createRenderer });

export { StgsPlayer, createWebGl2Renderer, createWorker, defineStgsPlayer };
export type { PlayerOptions, PlayerStats } from "./player/player";
export type { ScenePlayer } from "./player/scene_player";
export type {
  Camera, PackedSegment, Renderer, RenderView, SceneInfo, SegmentSink, ViewRenderer,
} from "./types";
export type { XrMode, XrOptions } from "./xr/presenter";
