// SPDX-License-Identifier: Apache-2.0
// Draws a scene in the render passes of the renderers of three.js.
import { ColorManagement, LinearSRGBColorSpace, SRGBColorSpace } from "three";
import type { Camera, Matrix4, PerspectiveCamera, WebGLRenderer } from "three";
import { EnginePlayer } from "../engine/engine_player";
import { GpuEnginePlayer } from "../engine/gpu_engine_player";
import type { SegmentPlayerOptions } from "../player/segment_player";
import { drawBetween } from "./backend";
import type { Backend, ThreeGpuRenderer } from "./backend";

/** A player, and how its image is drawn. */
export interface Drawing {
  readonly player: EnginePlayer | GpuEnginePlayer;
  /** Draws into the current render pass. `renderer` is the one that the scene was created for. */
  draw(renderer: WebGLRenderer, camera: Camera, worldFromScene: Matrix4): void;
}

type Renderer = WebGLRenderer | ThreeGpuRenderer;

/** Creates the player of a scene for a renderer. See `StgsMesh` for errors. */
export function drawingOf(renderer: Renderer, options: SegmentPlayerOptions, onChange: () => void): Drawing {
  if ("isWebGLRenderer" in renderer && renderer.isWebGLRenderer === true) {
    return webGlDrawing(new EnginePlayer(renderer.getContext() as WebGL2RenderingContext, options, onChange));
  }
  if (!("isWebGPURenderer" in renderer) || renderer.isWebGPURenderer !== true) {
    throw new Error("StgsMesh needs a WebGLRenderer or a WebGPURenderer of three.js");
  }
  const { isWebGPUBackend, device, gl } = renderer.backend as Backend;
  if (isWebGPUBackend === true && device) return gpuDrawing(renderer, new GpuEnginePlayer(device, options, onChange));
  if (gl instanceof WebGL2RenderingContext) return fallbackDrawing(renderer, new EnginePlayer(gl, options, onChange));
  throw new Error("StgsMesh needs a WebGPURenderer that is initialized; create it after `await renderer.init()`");
}

function viewOf(camera: Camera, worldFromScene: Matrix4) {
  const perspective = camera as PerspectiveCamera;
  return {
    projection: camera.projectionMatrix.elements,
    viewFromWorld: camera.matrixWorldInverse.elements,
    worldFromScene: worldFromScene.elements,
    near: perspective.near,
    isReversed: perspective.reversedDepth === true,
  };
}

function webGlDrawing(player: EnginePlayer): Drawing {
  const draw = (renderer: WebGLRenderer, camera: Camera, worldFromScene: Matrix4) => {
    const target = renderer.getRenderTarget();
    let colourSpace = renderer.outputColorSpace;
    if (target !== null) {
      colourSpace = target.isXRRenderTarget ? target.texture.colorSpace : LinearSRGBColorSpace;
    }
    player.draw({
      ...viewOf(camera, worldFromScene),
      logarithmicFar: renderer.capabilities.logarithmicDepthBuffer ? (camera as PerspectiveCamera).far : null,
      isLinear: colourSpace === LinearSRGBColorSpace,
    });
  };
  return { player, draw };
}

/** Whether WebGPURenderer draws linear colours, which it encodes in a pass of its own. */
function isWorkingLinear(): boolean {
  const { enabled, workingColorSpace } = ColorManagement;
  if (!enabled || workingColorSpace === SRGBColorSpace) return false;
  if (workingColorSpace === LinearSRGBColorSpace) return true;
  throw new Error(
    `StgsMesh does not support the working colour space ${workingColorSpace}; ` +
    `set ColorManagement.workingColorSpace to LinearSRGBColorSpace`);
}

function gpuDrawing(created: ThreeGpuRenderer, player: GpuEnginePlayer): Drawing {
  const { logarithmicDepthBuffer } = created as { logarithmicDepthBuffer?: boolean };
  const draw = (_renderer: WebGLRenderer, camera: Camera, worldFromScene: Matrix4) => {
    const perspective = camera as PerspectiveCamera;
    if (perspective.isArrayCamera === true) {
      throw new Error("StgsMesh supports headsets and array cameras with WebGLRenderer only");
    }
    if (!player.hasImage) return;
    const isLinear = isWorkingLinear();
    drawBetween(created, (target) => player.draw({
      ...viewOf(camera, worldFromScene), isLinear,
      logarithmicFar: logarithmicDepthBuffer === true ? perspective.far : null,
    }, target));
  };
  return { player, draw };
}

/** WebGPURenderer where there is no WebGPU. */
function fallbackDrawing(created: ThreeGpuRenderer, player: EnginePlayer): Drawing {
  const { logarithmicDepthBuffer } = created as { logarithmicDepthBuffer?: boolean };
  if (logarithmicDepthBuffer === true) {
    player.destroy();
    throw new Error("StgsMesh does not support logarithmicDepthBuffer where WebGPURenderer draws with WebGL 2; " +
      "use reversedDepthBuffer or WebGLRenderer");
  }
  const draw = (_renderer: WebGLRenderer, camera: Camera, worldFromScene: Matrix4) => player.draw({
    ...viewOf(camera, worldFromScene), logarithmicFar: null, isLinear: isWorkingLinear(),
  });
  return { player, draw };
}
