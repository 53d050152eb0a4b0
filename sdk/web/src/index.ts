// SPDX-License-Identifier: Apache-2.0
// The package: importing it defines <stgs-player>.
import { defineStgsPlayer } from "./element/stgs_player";
import { StgsPlayer } from "./player/player";
import type { PlayerOptions } from "./player/player";
import { createWebGl2Renderer } from "./webgl2";

/** Creates the worker that fetches and decodes a scene. */
export function createWorker(): Worker {
  return new Worker(new URL("./stgs-worker.js", import.meta.url), { type: "module", name: "stgs" });
}

/** Creates a player that draws to a canvas. Throws if the browser has no WebGL2. */
export function createPlayer(canvas: HTMLCanvasElement,
                             options: Pick<PlayerOptions, "memoryBudget" | "lookAhead"> = {}): StgsPlayer {
  return new StgsPlayer({ canvas, renderer: createRenderer(canvas), worker: createWorker, ...options });
}

function createRenderer(canvas: HTMLCanvasElement) {
  return createWebGl2Renderer(canvas, { sorterUrl: new URL("./stgs-sorter.js", import.meta.url) });
}

if (typeof customElements !== "undefined" && customElements.get("stgs-player") === undefined)
  defineStgsPlayer({ createWorker, createRenderer });

export { StgsPlayer, createWebGl2Renderer, defineStgsPlayer };
export type { PlayerOptions, PlayerStats } from "./player/player";
export type { Camera, PackedSegment, Renderer, SceneInfo } from "./types";
