// SPDX-License-Identifier: Apache-2.0
// The part of WebGPURenderer of three.js that the adapter uses. three.js has no public way to draw between
// the objects of a render pass, so the adapter reads the render context of the pass.
import { REVISION } from "three";
import type { GpuEngineTarget, TexturePart } from "../engine/gpu_target";
import type {
  GPUCommandEncoder, GPUDevice, GPURenderPassDescriptor, GPUTexture,
} from "../webgpu/webgpu_types";

/** A `WebGPURenderer` of three.js; declared here because the types of its versions differ. */
export interface ThreeGpuRenderer {
  readonly isWebGPURenderer?: boolean;
  readonly backend: object;
}

/** `backend` of the renderer: of WebGPU, or of WebGL 2 where there is no WebGPU. */
export interface Backend {
  readonly isWebGPUBackend?: boolean;
  readonly isWebGLBackend?: boolean;
  /** Null or missing before renderer.init() has finished. */
  readonly device?: GPUDevice | null;
  readonly gl?: WebGL2RenderingContext | null;
  /** The data of an object of three.js. */
  get(object: object): unknown;
  getContext(): { getCurrentTexture(): GPUTexture };
  readonly textureUtils: {
    getColorBuffer(): GPUTexture;
    getDepthBuffer(depth: boolean, stencil: boolean): GPUTexture;
  };
}

interface ThreeTexture {
  readonly name: string;
  readonly isArrayTexture?: boolean;
  readonly isCubeTexture?: boolean;
}

interface TextureData {
  readonly texture: GPUTexture;
  readonly msaaTexture?: GPUTexture;
  readonly msaaTextures?: readonly GPUTexture[];
  readonly externalTexture?: boolean;
}

interface ThreeRectangle {
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
  readonly minDepth?: number;
  readonly maxDepth?: number;
}

/** The render pass of a render() call. */
interface RenderContext {
  /** Null, or in older versions missing, without several outputs. */
  readonly mrt?: object | null;
  readonly renderTarget: { readonly isRenderTarget3D?: boolean } | null;
  /** Null: the canvas. */
  readonly textures: readonly ThreeTexture[] | null;
  readonly depthTexture: ThreeTexture | null;
  readonly depth: boolean;
  readonly stencil: boolean;
  readonly viewport: boolean;
  readonly viewportValue: ThreeRectangle;
  readonly scissor: boolean;
  readonly scissorValue: ThreeRectangle;
  readonly activeCubeFace: number;
  readonly activeMipmapLevel: number;
  readonly occlusionQueryCount: number;
}

/** The data of the backend for a render context. */
interface PassData {
  /** Null or missing outside of a render pass, as in compileAsync(). */
  encoder?: GPUCommandEncoder | null;
  /** Has no `end` while a bundle is recorded. */
  currentPass: { end?(): void } | null;
  readonly descriptor: GPURenderPassDescriptor & {
    colorAttachments: { storeOp: string }[];
    depthStencilAttachment?: {
      depthLoadOp?: string; stencilLoadOp?: string; depthStoreOp?: string; stencilStoreOp?: string;
    };
  };
  /** The state set in the pass. */
  currentSets: object;
  currentStencilRef?: number;
  currentBlendColor?: { setRGB(r: number, g: number, b: number): void };
  currentBlendAlpha?: number;
}

interface Internals {
  readonly backend: Backend;
  readonly depth: boolean;
  readonly stencil: boolean;
  readonly currentSamples: number;
  readonly _currentRenderContext?: RenderContext | null;
}

/**
 * Ends the current render pass and submits its commands, calls `draw` with its attachments, and begins the
 * pass again. Does nothing outside of a render pass, or if the pass has no output colour. Throws an Error
 * if the pass cannot be interrupted.
 */
export function drawBetween(renderer: ThreeGpuRenderer, draw: (target: GpuEngineTarget) => void): void {
  const internals = renderer as unknown as Internals;
  const { backend, _currentRenderContext: context } = internals;
  if (context === undefined) {
    throw new Error(`StgsMesh does not support WebGPURenderer of three.js r${REVISION}; use r180 to r187, or WebGLRenderer`);
  }
  const pass = context === null ? null : backend.get(context) as PassData;
  const { device } = backend;
  if (context === null || pass === null || !pass.encoder || !device) return;
  checkPass(context, pass);
  const target = targetOf(internals, context);
  if (target === null) return;
  (pass.currentPass as { end(): void }).end();
  device.queue.submit([pass.encoder.finish()]);
  try {
    draw(target);
  } finally {
    resume(device, context, pass);
  }
}

function checkPass(context: RenderContext, { currentPass, descriptor }: PassData): void {
  if (context.textures !== null && context.renderTarget?.isRenderTarget3D === true) {
    throw new Error("StgsMesh cannot be drawn to a RenderTarget3D");
  }
  if (currentPass === null) throw new Error("StgsMesh supports headsets and array cameras with WebGLRenderer only");
  if (currentPass.end === undefined) throw new Error("StgsMesh cannot be part of a BundleGroup");
  if (context.occlusionQueryCount > 0) {
    throw new Error("StgsMesh cannot be drawn with objects whose occlusionTest is true; set it to false");
  }
  const { colorAttachments, depthStencilAttachment: depth } = descriptor;
  const isDiscarded = [...colorAttachments.map(({ storeOp }) => storeOp), depth?.depthStoreOp, depth?.stencilStoreOp]
    .includes("discard");
  if (isDiscarded) {
    throw new Error("StgsMesh needs render targets that store their samples; set storeMultisampledColorBuffer, " +
      "storeMultisampledDepthBuffer and storeMultisampledStencilBuffer to true");
  }
}

function targetOf(renderer: Internals, context: RenderContext): GpuEngineTarget | null {
  const { x, y, width, height, minDepth = 0, maxDepth = 1 } = context.viewportValue;
  const attachments = context.textures === null
    ? canvasParts(renderer, context)
    : targetParts(renderer.backend, context, context.textures);
  return attachments && {
    ...attachments,
    viewport: { x, y, width, height, minDepth, maxDepth },
    scissor: context.scissor ? context.scissorValue : null,
  };
}

type Attachments = Pick<GpuEngineTarget, "colour" | "depth">;

function canvasParts({ backend, currentSamples, depth, stencil }: Internals, context: RenderContext): Attachments {
  const part = (texture: GPUTexture): TexturePart => ({ texture, level: 0, layer: 0 });
  const { textureUtils } = backend;
  return {
    colour: part(currentSamples > 1 ? textureUtils.getColorBuffer() : backend.getContext().getCurrentTexture()),
    depth: context.depth ? part(textureUtils.getDepthBuffer(depth, stencil)) : null,
  };
}

function targetParts(
  backend: Backend, context: RenderContext, textures: readonly ThreeTexture[],
): Attachments | null {
  const { mrt, activeCubeFace, activeMipmapLevel, depthTexture } = context;
  // Of the outputs of a pass for several textures, the colour is named "output".
  const colour = mrt ? textures.find(({ name }) => name === "output") : textures[0];
  if (colour === undefined) return null;
  const data = backend.get(colour) as TextureData;
  if (data.externalTexture === true) throw new Error("StgsMesh supports headsets with WebGLRenderer only");
  if (data.msaaTextures !== undefined) {
    throw new Error("StgsMesh cannot be drawn to a render target with layers and several samples; set samples to 0");
  }
  const layerOf = ({ isArrayTexture, isCubeTexture }: ThreeTexture) =>
    (isArrayTexture === true || isCubeTexture === true ? activeCubeFace : 0);
  return {
    colour: data.msaaTexture === undefined
      ? { texture: data.texture, level: activeMipmapLevel, layer: activeCubeFace }
      : { texture: data.msaaTexture, level: 0, layer: 0 },
    depth: context.depth && depthTexture !== null
      ? { texture: (backend.get(depthTexture) as TextureData).texture, level: 0, layer: layerOf(depthTexture) }
      : null,
  };
}

/** Begins the pass of a context again, keeping its content, and clears the record of the state set in it. */
function resume(device: GPUDevice, context: RenderContext, pass: PassData): void {
  const { descriptor } = pass;
  for (const attachment of descriptor.colorAttachments) attachment.loadOp = "load";
  const { depthStencilAttachment: depth } = descriptor;
  if (depth !== undefined && context.depth) depth.depthLoadOp = "load";
  if (depth !== undefined && context.stencil) depth.stencilLoadOp = "load";
  pass.encoder = device.createCommandEncoder();
  const currentPass = pass.encoder.beginRenderPass(descriptor);
  pass.currentPass = currentPass;
  pass.currentSets = { attributes: {}, bindingGroups: [], pipeline: null, index: null };
  pass.currentStencilRef = 0;
  pass.currentBlendColor?.setRGB(0, 0, 0);
  pass.currentBlendAlpha = 0;
  if (context.viewport) {
    const { x, y, width, height, minDepth = 0, maxDepth = 1 } = context.viewportValue;
    currentPass.setViewport(x, y, width, height, minDepth, maxDepth);
  }
  if (context.scissor) {
    const { x, y, width, height } = context.scissorValue;
    currentPass.setScissorRect(x, y, width, height);
  }
}
