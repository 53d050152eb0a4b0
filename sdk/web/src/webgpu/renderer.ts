// SPDX-License-Identifier: Apache-2.0
import { copyCamera } from "../camera";
import { abortError, deviceLost, errorOf } from "../player/errors";
import type { Camera, PackedSegment, Renderer, RendererStatistics, SceneInfo } from "../types";
import { SplatRenderer } from "./splat_renderer";
import type { Background } from "./view_buffer";
import type { GPU, GPUAdapter, GPUCanvasContext, GPUDevice, GPUTextureFormat } from "./webgpu_types";

/** Settings of a WebGPU renderer. */
export interface WebGpuOptions {
  /** Premultiplied, sRGB-encoded, 0 to 1. Alpha 0: the page shows. Default: the scene's. */
  background?: Background;
  /** Ends the creation, which rejects then; later it has no effect. */
  signal?: AbortSignal;
}

/** Frames in flight on the GPU, at most; more would only add latency. */
const kMaxInFlight = 3;
const kDestroyed = "the renderer was destroyed";
/** Limits of which the largest value of the adapter is requested. */
const kLimits = ["maxBufferSize", "maxStorageBufferBindingSize", "maxTextureDimension2D"] as const;

class WebGpuRenderer implements Renderer {
  readonly name = "webgpu";
  readonly views = null;
  onError: (error: Error) => void = (error) => console.error(error);
  private readonly background: Background | null;
  private sceneBackground: Background = [0, 0, 0, 1];
  failure: Error | null = null; // final
  private isDestroyed = false;
  private inFlight = 0; // frames
  private finished = 0; // frames
  private waiting: { camera: Camera; ticks: number } | null = null;

  constructor(
    private readonly canvas: HTMLCanvasElement, private readonly device: GPUDevice,
    private readonly context: GPUCanvasContext, private readonly splats: SplatRenderer,
    options: WebGpuOptions,
  ) {
    this.background = options.background ?? null;
    device.addEventListener("uncapturederror", ({ error }) => {
      const isMemory = error.constructor.name === "GPUOutOfMemoryError";
      this.fail(new Error(isMemory
        ? "the GPU has no memory for the scene; lower the memory budget"
        : `WebGPU failed: ${error.message}`));
    });
    device.lost.then(({ message }) => {
      this.fail(deviceLost(
        `the GPU device was lost${message ? `: ${message}` : ""}; load the scene again`));
    });
  }

  get statistics(): RendererStatistics {
    return { ...this.splats.statistics, frames: this.finished };
  }

  get maxPrimitives(): number {
    return this.splats.maxPrimitives;
  }

  /** Removes all segments: those of another scene have other ids. */
  setScene(info: SceneInfo): void {
    const [red, green, blue] = info.background as [number, number, number];
    this.sceneBackground = [red, green, blue, 1];
    this.splats.setScene(info);
  }

  addSegment(segment: PackedSegment): void {
    this.splats.addSegment(segment);
  }

  removeSegment(id: number): void {
    this.splats.removeSegment(id);
  }

  /** While the GPU is behind, draws the newest of the frames once it has finished others. */
  render(camera: Camera, ticks: number): void {
    if (this.failure !== null) throw this.failure;
    this.waiting = null;
    if (this.inFlight < kMaxInFlight) this.draw(camera, ticks);
    else this.waiting = { camera: copyCamera(camera), ticks };
  }

  /** Draws at once: each frame is sorted for its own camera and time. */
  async renderExactly(camera: Camera, ticks: number): Promise<void> {
    if (this.failure !== null) throw this.failure;
    this.waiting = null;
    this.draw(camera, ticks);
  }

  async readPixels(): Promise<Float32Array> {
    if (this.failure !== null) throw this.failure;
    try {
      return await this.splats.read();
    } catch (error) {
      throw this.failure ?? error; // the reason for which the buffer was not mapped
    }
  }

  destroy(): void {
    if (this.isDestroyed) return;
    this.isDestroyed = true;
    this.failure ??= new Error(kDestroyed);
    this.splats.destroy();
    this.context.unconfigure();
    this.device.destroy();
  }

  private draw(camera: Camera, ticks: number): void {
    const { width, height } = camera;
    if (!(width > 0 && height > 0)) return; // a hidden canvas
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    const view = this.context.getCurrentTexture().createView();
    this.splats.draw(camera, ticks, view, this.background ?? this.sceneBackground);
    ++this.inFlight;
    this.device.queue.onSubmittedWorkDone().then(() => this.finish(), () => undefined);
  }

  /** A frame is finished. */
  private finish(): void {
    --this.inFlight;
    ++this.finished;
    const view = this.waiting;
    if (view === null || this.failure !== null) return;
    this.waiting = null;
    try {
      this.draw(view.camera, view.ticks);
    } catch (error) {
      this.fail(errorOf(error));
    }
  }

  /** Reports the first failure. */
  private fail(error: Error): void {
    if (this.failure !== null) return;
    this.failure = error;
    this.onError(this.failure);
  }
}

/** Returns an adapter, or throws an Error with the reason why there is none. */
async function adapterOf(gpu: GPU | undefined): Promise<GPUAdapter> {
  if (gpu === undefined) {
    const reason = isSecureContext ? "this browser does not have it" : "the page is not secure (https)";
    throw new Error(`WebGPU is not available: ${reason}`);
  }
  const adapter = await gpu.requestAdapter({ powerPreference: "high-performance" });
  if (adapter === null) throw new Error("WebGPU is not available: this browser has no adapter for it");
  return adapter;
}

function throwIfAborted(signal: AbortSignal | undefined): void {
  if (signal?.aborted === true) throw abortError("the creation of the renderer was aborted");
}

/** Compiles on a device, which is destroyed if that fails or is aborted. */
async function compile(
  device: GPUDevice, format: GPUTextureFormat, signal: AbortSignal | undefined,
): Promise<SplatRenderer> {
  const stop = () => device.destroy();
  signal?.addEventListener("abort", stop);
  try {
    throwIfAborted(signal);
    const splats = await SplatRenderer.create(device, format);
    throwIfAborted(signal);
    return splats;
  } catch (error) {
    stop();
    throwIfAborted(signal);
    throw error;
  } finally {
    signal?.removeEventListener("abort", stop);
  }
}

/**
 * Creates a renderer for a canvas without another context. The canvas takes the size of the camera
 * of each frame, whole pixels. Rejects with an Error if WebGPU is not available; the canvas then has
 * no context, unless it was refused for having one of another kind.
 *
 * After a failure, such as the loss of the device, `onError` is called once, and render() throws.
 */
export async function createWebGpuRenderer(
  canvas: HTMLCanvasElement, options: WebGpuOptions = {},
): Promise<Renderer> {
  const { gpu } = navigator as unknown as { gpu?: GPU };
  const adapter = await adapterOf(gpu);
  throwIfAborted(options.signal);
  const device = await adapter.requestDevice({
    requiredFeatures: ["timestamp-query", "subgroups"].filter((name) => adapter.features.has(name)),
    requiredLimits: Object.fromEntries(kLimits.map((name) => [name, adapter.limits[name]])),
  });
  const format = (gpu as GPU).getPreferredCanvasFormat();
  const splats = await compile(device, format, options.signal);
  const context = canvas.getContext("webgpu") as unknown as GPUCanvasContext | null;
  if (context === null) {
    device.destroy();
    throw new Error("the canvas has a context of another kind than WebGPU");
  }
  context.configure({ device, format, alphaMode: "premultiplied" });
  return new WebGpuRenderer(canvas, device, context, splats, options);
}
