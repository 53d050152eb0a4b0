// SPDX-License-Identifier: Apache-2.0
// A scene that is drawn inside the frames of a 3D engine with WebGPU.
import { textOf } from "../player/errors";
import { SegmentPlayer, SegmentPlayerOptions } from "../player/segment_player";
import { cameraOfMatrices, product } from "../webgl2/camera";
import type { SplatOutput, SplatRenderer, SplatView } from "../webgpu";
import type { GPUDepthFormat, GPUDevice, GPUTextureFormat } from "../webgpu/webgpu_types";
import { loadWebGpu } from "../webgpu_loader";
import { DeferredSplats } from "./deferred_splats";
import type { EngineView } from "./engine_view";
import { ContentCopy, drawnPixels, sizeOf, viewOf } from "./gpu_target";
import type { GpuEngineTarget } from "./gpu_target";

async function rendererOf(device: GPUDevice): Promise<SplatRenderer> {
  if (device.limits.maxStorageBuffersInVertexStage === 0) {
    throw new Error("the WebGPU device has only the features of compatibility mode; use WebGL 2 instead " +
      "(WebGPURenderer({ forceWebGL: true }) of three.js)");
  }
  const { SplatRenderer } = await loadWebGpu();
  return SplatRenderer.create(device, "rgba16float", { isLinear: true });
}

/** Plays a scene and draws it into textures of the engine, with the engine's device. */
export class GpuEnginePlayer extends SegmentPlayer {
  private readonly splats: DeferredSplats;
  private readonly content: ContentCopy;

  /** `onChange`: the image may have changed, so an engine that draws on demand has to draw. */
  constructor(device: GPUDevice, options: SegmentPlayerOptions, onChange: () => void) {
    const fail = (message: string) => this.playback.fail("unsupported", message);
    const splats = new DeferredSplats(
      rendererOf(device),
      (renderer) => {
        this.adaptation.limitRenderer(renderer.maxPrimitives);
        this.announce();
      },
      (error) => fail(`rendering failed: ${textOf(error)}`));
    super(splats, options, onChange);
    this.splats = splats;
    this.content = new ContentCopy(device);
    device.lost.then(({ message }) => {
      if (this.isDestroyed) return;
      fail(`the GPU device of the engine was lost${message ? `: ${message}` : ""}; create the engine's renderer again`);
    });
  }

  /** Whether draw() would draw something. */
  get hasImage(): boolean {
    return this.splats.renderer !== null && !this.isDestroyed && this.playback.frameTime() !== null;
  }

  /**
   * Submits commands that draw the current time, as the engine draws a transparent object: hidden by the
   * objects of the target's depth. All earlier drawing to the target must have been submitted. Throws an
   * Error if the projection is no perspective.
   */
  draw(view: EngineView, target: GpuEngineTarget): void {
    if (view.projection[15] !== 0) throw new Error("scenes need a perspective camera");
    const ticks = this.frameTicks();
    const { renderer } = this.splats;
    const drawn = drawnPixels(target);
    if (ticks === null || renderer === null || drawn === null) return;
    const [width, height] = sizeOf(target.colour);
    const { viewport } = target;
    const viewFromScene = product(view.viewFromWorld, view.worldFromScene);
    const camera = cameraOfMatrices(
      view.projection, viewFromScene, viewport.width, viewport.height, view.near);
    const splatView: SplatView = {
      camera: { ...camera, cx: camera.cx + viewport.x, cy: camera.cy + viewport.y, width, height },
      to: viewOf(target.colour),
      within: [drawn.x, drawn.y, drawn.width, drawn.height],
      ...(target.depth === null
        ? {}
        : { occluders: { depth: viewOf(target.depth), mapping: depthMapping(view, target) } }),
      ...(view.isLinear ? { content: this.content.update(target.colour) } : {}),
    };
    renderer.drawViews([splatView], ticks, null, outputOf(renderer, view, target));
  }

  override destroy(): void {
    if (this.isDestroyed) return;
    this.content.destroy();
    super.destroy();
  }
}

function outputOf(
  renderer: SplatRenderer, { isReversed, isLinear }: EngineView, { colour, depth }: GpuEngineTarget,
): SplatOutput {
  const { format, sampleCount } = colour.texture;
  const occluders = depth === null
    ? {}
    : { occluders: { format: depth.texture.format as GPUDepthFormat, isReversed } };
  return renderer.output(
    format as GPUTextureFormat, { ...occluders, samples: sampleCount as 1 | 4, isLinear });
}

/** `mapping` of the occluders, in units of the view. */
function depthMapping(
  { projection, near, logarithmicFar }: EngineView, { viewport: { minDepth, maxDepth } }: GpuEngineTarget,
): [number, number, number, number] {
  if (logarithmicFar !== null) {
    const factor = 1 / Math.log2(logarithmicFar / near);
    return [-factor * Math.log2(near), 0, factor, 0];
  }
  const range = maxDepth - minDepth;
  return [minDepth - range * (projection[10] as number), range * (projection[14] as number), 0, 1];
}
