// SPDX-License-Identifier: Apache-2.0
// A program that uses the types of the package: it has to compile.
import { createPlayer, SegmentPlayer, StgsPlayer } from "stgs";
import type { Camera, Renderer, SceneInfo } from "stgs";
import { createWebGl2Renderer } from "stgs/webgl2";
import { createWebGpuRenderer } from "stgs/webgpu";
import type { SplatRenderer, SplatView } from "stgs/webgpu";

export async function play(canvas: HTMLCanvasElement, file: File): Promise<SceneInfo | null> {
  const player: StgsPlayer = createPlayer(canvas, { memoryBudget: 2 ** 28, lookAhead: 5, renderer: "webgpu" });
  const isModern: boolean = player.activeRenderer === "webgpu";
  if (!isModern) console.log(player.stats.computeMs);
  await player.load(file, { signal: new AbortController().signal });
  player.currentTime = 0.5 * player.duration;
  await player.play();
  return player.info;
}

export function drawEyes(splats: SplatRenderer, player: SegmentPlayer, eyes: SplatView[]): void {
  const cameras: Camera[] = eyes.map(({ camera }) => camera);
  const ticks = player.frameTicks();
  if (ticks !== null && cameras.length > 0) splats.drawViews(eyes, ticks, null);
}

// @ts-expect-error: not a renderer
new SegmentPlayer({});

export async function rendererOf(canvas: HTMLCanvasElement): Promise<Renderer> {
  return "gpu" in navigator ? createWebGpuRenderer(canvas) : createWebGl2Renderer(canvas);
}

const element = document.createElement("stgs-player");
element.src = "scene.stgs";
element.loop = true;
// @ts-expect-error: not a camera
element.camera = "walk";
// @ts-expect-error: not a renderer
element.renderer = "webgl1";
