// SPDX-License-Identifier: Apache-2.0
import { errorOf } from "../player/errors";
import type { Camera, PackedSegment, Renderer, RendererStatistics, RenderView, SceneInfo, ViewRenderer } from "../types";
import { isParallel, sharedCamera } from "./camera";
import { Frame } from "./frame";
import type { Background, Viewport } from "./frame";
import { imageOutput } from "./splat_drawer";
import { SplatScene } from "./splat_scene";
import type { View } from "./view_order";
import { targetFormat } from "./target";
import type { TargetFormat } from "./target";

/** Settings of a WebGL2 renderer. */
export interface WebGl2Options {
  /** The best format to blend in. `statistics.targetFormat` is the one in use: rgba8 if the GPU cannot blend rgba16f. Default: rgba16f. */
  target?: TargetFormat;
  /** Premultiplied, sRGB-encoded, 0 to 1. Alpha 0: the page shows. Default: the scene's. */
  background?: Background;
  /** Of stgs-sorter.js. Default: next to the module. */
  sorterUrl?: string | URL;
  /**
   * Whether the renderer restores its segments after the GPU context was lost. It then retains
   * their words in the memory of the worker, 80 to 168 bytes per primitive instead of 40. Default:
   * true. If false, the caller adds all segments again.
   */
  restoresContext?: boolean;
  /**
   * Whether views have a depth. It needs the extension EXT_color_buffer_float. Without EXT_float_blend,
   * depths are summed as half floats, which is less precise. Default: false.
   */
  depth?: boolean;
  /** Receives failures that no call can report, as of the worker. Default: console.error. */
  onError?: (error: Error) => void;
}

const kClear: Background = [0, 0, 0, 0];

class WebGl2Renderer implements Renderer, ViewRenderer {
  readonly name = "webgl2";
  readonly views = this;
  onError: (error: Error) => void;
  private readonly splats: SplatScene;
  private readonly format: TargetFormat;
  private readonly hasDepth: boolean;
  private readonly background: Background | null;
  private sceneBackground: Background = [0, 0, 0, 1];
  private frame: Frame | null; // null while the context is lost
  private onCanvas: View | null = null; // of the last frame; null: it was not on the canvas
  private frames = 0; // calls of render() and renderViews()

  constructor(
    private readonly canvas: HTMLCanvasElement, readonly context: WebGL2RenderingContext,
    options: WebGl2Options,
  ) {
    this.background = options.background ?? null;
    this.onError = options.onError ?? ((error) => console.error(error));
    this.format = targetFormat(context, options.target ?? "rgba16f");
    this.hasDepth = options.depth ?? false;
    this.frame = new Frame(context, this.format, this.hasDepth);
    this.splats = new SplatScene(context, {
      sorterUrl: options.sorterUrl ?? new URL("./stgs-sorter.js", import.meta.url),
      restoresContext: options.restoresContext ?? true,
      hasDepth: this.hasDepth,
      report: (error) => this.onError(error),
      onOrder: () => this.drawSoon(),
    });
    canvas.addEventListener("webglcontextlost", this.onLost);
    canvas.addEventListener("webglcontextrestored", this.onRestored);
  }

  get statistics(): RendererStatistics {
    return { ...this.splats.statistics, targetFormat: this.format };
  }

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

  render(camera: Camera, ticks: number): void {
    ++this.frames;
    this.splats.setViews(1);
    this.drawCanvas(camera, ticks);
    this.onCanvas = this.splats.follow(camera, ticks);
  }

  renderExactly(camera: Camera, ticks: number): Promise<void> {
    return this.splats.orderExactly(camera, ticks, (view) => {
      this.onCanvas = view;
      this.drawCanvas(view.camera, view.ticks);
    });
  }

  renderViews(
    to: WebGLFramebuffer | null, views: readonly RenderView[], ticks: number, isClear: boolean,
  ): void {
    const cameras = views.map((view) => view.camera);
    const [first, ...others] = cameras;
    if (first === undefined) return;
    if (!this.hasDepth && views.some((view) => view.depth !== undefined)) {
      throw new Error("a view has a depth texture, but the renderer was created without the option depth");
    }
    this.onCanvas = null;
    ++this.frames;
    const isShared = others.every((camera) => isParallel(first, camera));
    this.splats.setViews(isShared ? 1 : views.length);
    views.forEach(({ camera, x, y, depth }, k) => {
      const at = { x, y, width: camera.width, height: camera.height };
      const background = isClear ? kClear : this.opaqueBackground();
      this.drawImage(camera, ticks, to, at, background, isShared ? 0 : k);
      if (depth !== undefined) this.frame?.writeDepth(depth);
    });
    if (isShared) this.splats.follow(sharedCamera([first, ...others]), ticks);
    else cameras.forEach((camera, k) => this.splats.follow(camera, ticks, k));
  }

  async readPixels(): Promise<Float32Array> {
    return this.frame?.read() ?? new Float32Array(0);
  }

  destroy(): void {
    this.canvas.removeEventListener("webglcontextlost", this.onLost);
    this.canvas.removeEventListener("webglcontextrestored", this.onRestored);
    this.onCanvas = null;
    this.splats.destroy();
    this.frame?.destroy();
    this.frame = null;
  }

  private opaqueBackground(): Background {
    return this.background ?? this.sceneBackground;
  }

  private drawCanvas(camera: Camera, ticks: number): void {
    const { width, height } = camera;
    if (this.frame === null || !(width > 0 && height > 0)) return; // lost, or a hidden canvas
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    this.drawImage(camera, ticks, null, { x: 0, y: 0, width, height }, this.opaqueBackground());
  }

  private drawImage(
    camera: Camera, ticks: number, to: WebGLFramebuffer | null, at: Viewport,
    background: Background, view = 0,
  ): void {
    const { frame } = this;
    if (frame === null) return;
    frame.begin(camera.width, camera.height);
    this.splats.draw(camera, ticks, imageOutput(camera.height, () => frame.bind()), view);
    frame.show(to, at, background);
  }

  /** Draws the canvas in the new order, unless the caller renders in the same frame anyway. */
  private drawSoon(): void {
    const { frames } = this;
    requestAnimationFrame(() => {
      if (this.frames !== frames || this.onCanvas === null) return;
      this.drawCanvas(this.onCanvas.camera, this.onCanvas.ticks);
    });
  }

  private readonly onLost = (event: Event): void => {
    event.preventDefault(); // so that the context is restored
    this.frame = null;
    this.splats.lose();
  };

  private readonly onRestored = (): void => {
    try {
      targetFormat(this.context, this.format); // extensions are lost as well
      this.frame = new Frame(this.context, this.format, this.hasDepth);
      this.splats.restore();
    } catch (error) {
      this.onError(errorOf(error));
    }
  };
}

/**
 * Creates a renderer for a canvas without another context. The canvas takes the size of the camera
 * of each frame, whole pixels. Throws an Error if WebGL2 is not available, or an extension that the
 * options need.
 *
 * While the GPU context is lost, nothing is drawn, renderExactly() does not resolve, and readPixels() returns no
 * pixels.
 */
export function createWebGl2Renderer(
  canvas: HTMLCanvasElement, options: WebGl2Options = {},
): Renderer & ViewRenderer {
  const gl = canvas.getContext("webgl2", {
    alpha: true, antialias: false, depth: false, stencil: false,
    powerPreference: "high-performance",
  });
  if (gl === null) {
    throw new Error("WebGL2 is not available; use a browser with hardware acceleration");
  }
  return new WebGl2Renderer(canvas, gl, options);
}
