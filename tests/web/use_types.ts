// SPDX-License-Identifier: Apache-2.0
// A program that uses the types of the package: it has to compile.
import { createPlayer, StgsPlayer } from "stgs";
import type { SceneInfo } from "stgs";

export async function play(canvas: HTMLCanvasElement, file: File): Promise<SceneInfo | null> {
  const player: StgsPlayer = createPlayer(canvas, { memoryBudget: 2 ** 28, lookAhead: 5, renderer: "webgpu" });
  const isModern: boolean = player.activeRenderer === "webgpu";
  if (!isModern) console.log(player.stats.computeMs);
  await player.load(file, { signal: new AbortController().signal });
  player.currentTime = 0.5 * player.duration;
  await player.play();
  return player.info;
}

const element = document.createElement("stgs-player");
element.src = "scene.stgs";
element.loop = true;
// @ts-expect-error: not a camera
element.camera = "walk";
// @ts-expect-error: not a renderer
element.renderer = "webgl1";
