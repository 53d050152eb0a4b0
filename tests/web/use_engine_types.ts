// SPDX-License-Identifier: Apache-2.0
// Programs that use the types of the adapters: they have to compile.
import { Entity } from "playcanvas";
import { setResources as setScriptResources, StgsScript } from "stgs/playcanvas";
import type { Resources } from "stgs/three";
import { setResources, StgsMesh } from "stgs/three";
import { WebGLRenderer } from "three";

export function inline(files: Resources): void {
  setResources(files);
  setScriptResources(files);
}

export async function playMesh(renderer: WebGLRenderer, file: File): Promise<StgsMesh> {
  const mesh = new StgsMesh({ renderer, loop: true, memoryBudget: 2 ** 28, quality: "low", device: "phone" });
  mesh.player.addEventListener("qualitychange", () => (mesh.player.quality = "auto"));
  await mesh.player.load(file);
  await mesh.player.play();
  mesh.player.addEventListener("ended", () => mesh.dispose());
  return mesh;
}

/** `WebGPURenderer` of "three/webgpu" has these properties. */
export function playGpuMesh(renderer: { isWebGPURenderer: true; backend: object }): StgsMesh {
  return new StgsMesh({ renderer, src: "scene.stgs", autoplay: true });
}

export function durationOf(script: StgsScript): number {
  const entity: Entity = script.entity;
  entity.once("destroy", () => script.player?.destroy());
  return script.player?.duration ?? NaN;
}

// @ts-expect-error: the renderer is missing
new StgsMesh({ src: "scene.stgs" });
