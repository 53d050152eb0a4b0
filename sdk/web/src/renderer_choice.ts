// SPDX-License-Identifier: Apache-2.0
// The renderers of the package are bundles of their own, which are loaded when they are used.
import { DeferredRenderer } from "./player/deferred_renderer";
import { textOf } from "./player/errors";
import { sorterUrl } from "./resources";
import type { Renderer } from "./types";
import type { GPU } from "./webgpu/webgpu_types";
import { loadWebGpu } from "./webgpu_loader";
import { xrSystem } from "./xr/webxr";

/**
 * "auto": WebGPU if the browser has an adapter for it and shows nothing in headsets, which needs
 * WebGL2; otherwise WebGL2.
 */
export type RendererChoice = "auto" | "webgpu" | "webgl2";

async function webGpu(canvas: HTMLCanvasElement, signal: AbortSignal): Promise<Renderer> {
  const { createWebGpuRenderer } = await loadWebGpu();
  return createWebGpuRenderer(canvas, { signal });
}

async function webGl2(canvas: HTMLCanvasElement): Promise<Renderer> {
  const { createWebGl2Renderer } = await import("./stgs-webgl2.js");
  return createWebGl2Renderer(canvas, { sorterUrl: sorterUrl() });
}

async function hasWebGpu(): Promise<boolean> {
  const { gpu } = navigator as unknown as { gpu?: GPU };
  const adapter = await gpu?.requestAdapter({ powerPreference: "high-performance" });
  return adapter !== undefined && adapter !== null;
}

async function hasHeadset(): Promise<boolean> {
  const supports = (mode: string) => xrSystem()?.isSessionSupported(mode).catch(() => false); // not allowed
  const [vr, ar] = await Promise.all([supports("immersive-vr"), supports("immersive-ar")]);
  return (vr || ar) ?? false;
}

async function automatic(canvas: HTMLCanvasElement, signal: AbortSignal): Promise<Renderer> {
  const hasGpu = hasWebGpu(); // in parallel, because both queries take time
  hasGpu.catch(() => undefined); // reported below, if it matters
  try {
    if (!(await hasHeadset()) && (await hasGpu)) return await webGpu(canvas, signal);
  } catch (error) {
    if (signal.aborted) throw error;
    console.warn(`stgs: drawing with WebGL2, because WebGPU failed: ${textOf(error)}`);
  }
  return webGl2(canvas);
}

const kRenderers = { auto: automatic, webgpu: webGpu, webgl2: webGl2 };

/**
 * Returns the renderer of a choice for a canvas without a context. It is loaded while the player
 * fetches. Throws a TypeError if there is no such choice.
 */
export function chosenRenderer(canvas: HTMLCanvasElement, choice: RendererChoice): Renderer {
  if (!Object.keys(kRenderers).includes(choice)) {
    throw new TypeError(`there is no renderer "${choice}" (expected auto, webgpu or webgl2)`);
  }
  return new DeferredRenderer((signal) => kRenderers[choice](canvas, signal));
}
