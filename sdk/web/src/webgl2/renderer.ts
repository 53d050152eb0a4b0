// SPDX-License-Identifier: Apache-2.0
import { copyCamera } from "../camera";
import { checkWords, padded } from "../packed_segment";
import type { Camera, PackedSegment, Renderer, SceneInfo } from "../types";
import { FrameDrawer } from "./frame";
import type { Background } from "./frame";
import { Residents } from "./residents";
import { kSorterBytes } from "./sorter";
import type { Order, SortRequest } from "./sorter";
import { SorterClient } from "./sorter_client";
import { targetFormat } from "./target";
import type { TargetFormat } from "./target";

/** Settings of a WebGL2 renderer. */
export interface WebGl2Options {
  /** The best format to blend in; rgba8 where half floats cannot be blended. Default: rgba16f. */
  target?: TargetFormat;
  /** Premultiplied, sRGB-encoded, 0 to 1. Alpha 0: the page shows. Default: the scene's. */
  background?: Background;
  /** Of sorter_worker.js. Default: next to the module. */
  sorterUrl?: string | URL;
  /**
   * Whether the renderer restores its segments after the GPU context was lost. It then retains
   * their words in the memory of the worker, 80 to 168 bytes per primitive instead of 40. Default:
   * true. If false, the caller adds all segments again.
   */
  restoresContext?: boolean;
  /** Receives failures that no call can report, as of the worker. Default: console.error. */
  onError?: (error: Error) => void;
}

/** Successive frames that are more seconds apart are a seek, not playback. */
const kMaxStep = 0.25;
/** Bounds how far the order looks ahead, frames. */
const kMaxLatency = 8;

interface View {
  camera: Camera;
  ticks: number;
  until: number; // ticks; the latest time, or the earliest in reverse, at which its order is used
}

interface ExactView extends View {
  resolve: () => void;
  reject: (error: Error) => void;
}

function requestOf({ camera, ticks, until }: View): SortRequest {
  const [x, y, z] = camera.rotation.slice(6, 9) as [number, number, number];
  const offset = camera.translation[2] as number;
  return { direction: [x, y, z], offset, near: camera.near, ticks, until };
}

function isSameOrder(a: View, b: View): boolean {
  return JSON.stringify(requestOf(a)) === JSON.stringify(requestOf(b));
}

class WebGl2Renderer implements Renderer {
  readonly name = "webgl2";
  onError: (error: Error) => void;
  readonly statistics = { primitives: 0, visible: 0, sortMs: 0 };
  private readonly sorter: SorterClient;
  private readonly format: TargetFormat;
  private readonly background: Background | null;
  private sceneBackground: Background = [0, 0, 0, 1];
  private readonly restores: boolean;
  private readonly residents = new Residents();
  private drawer: FrameDrawer | null; // null while the context is lost
  private order: Order | null = null;
  private failure: Error | null = null; // of the sorter; final
  private latest: View | null = null; // of the last call that draws
  private sorted: View | null = null; // of the newest request; null if segments changed since then
  private renders = 0; // calls of render()
  private rendersAtRequest = 0;
  private latency = 0; // of the sorter, in calls of render()
  private tickSeconds = 1 / 30;
  private inFlight: ExactView | null = null;
  private isOutdated = false; // the reply in flight precedes the restored words
  private readonly waiting: ExactView[] = [];

  constructor(
    private readonly canvas: HTMLCanvasElement, private readonly gl: WebGL2RenderingContext,
    options: WebGl2Options,
  ) {
    this.background = options.background ?? null;
    this.restores = options.restoresContext ?? true;
    this.onError = options.onError ?? ((error) => console.error(error));
    this.format = targetFormat(gl, options.target ?? "rgba16f");
    this.drawer = new FrameDrawer(gl, this.format);
    const url = options.sorterUrl ?? new URL("sorter_worker.js", import.meta.url);
    this.sorter = new SorterClient(url, {
      onOrder: (order, milliseconds) => this.adopt(order, milliseconds),
      onWords: (key, words) => this.restoreWords(key, words),
      onFailure: (message) => this.fail(new Error(message)),
    });
    canvas.addEventListener("webglcontextlost", this.onLost);
    canvas.addEventListener("webglcontextrestored", this.onRestored);
  }

  /** Removes all segments: those of another scene have other ids. */
  setScene(info: SceneInfo): void {
    this.tickSeconds = info.tickSeconds;
    const [red, green, blue] = info.background as [number, number, number];
    this.sceneBackground = [red, green, blue, 1];
    for (const id of this.residents.ids()) this.removeSegment(id);
  }

  addSegment(segment: PackedSegment): void {
    checkWords(segment);
    const rows = this.drawer?.atlas.add(new Uint32Array(segment.words)) ?? null;
    this.removeSegment(segment.id);
    const resident = this.residents.add(segment);
    resident.rows = rows;
    const { key, id, primitives, begin, end, origin } = resident;
    const words = this.restores
      ? segment.words
      : segment.words.slice(0, kSorterBytes * padded(primitives));
    this.sorter.add({ key, id, primitives, begin, end, origin, words });
    this.sorted = null;
    this.statistics.primitives = this.residents.primitives;
  }

  removeSegment(id: number): void {
    const resident = this.residents.remove(id);
    if (resident === null) return;
    this.sorter.remove(resident.key);
    this.sorted = null;
    this.statistics.primitives = this.residents.primitives;
    if (!this.sorter.isBusy) this.release();
  }

  render(camera: Camera, ticks: number): void {
    this.latest = { camera: copyCamera(camera), ticks, until: this.predict(ticks) };
    ++this.renders;
    this.draw(this.latest);
    this.requestOrder();
  }

  renderExactly(camera: Camera, ticks: number): Promise<void> {
    if (this.failure !== null) return Promise.reject(this.failure);
    const view = { camera: copyCamera(camera), ticks, until: ticks };
    this.latest = view;
    return new Promise((resolve, reject) => {
      this.waiting.push({ ...view, resolve, reject });
      this.requestOrder();
    });
  }

  async readPixels(): Promise<Float32Array> {
    return this.drawer?.read() ?? new Float32Array(0);
  }

  destroy(): void {
    this.canvas.removeEventListener("webglcontextlost", this.onLost);
    this.canvas.removeEventListener("webglcontextrestored", this.onRestored);
    this.sorter.destroy();
    this.drawer?.destroy();
    this.drawer = null;
    this.latest = null;
    this.fail(new Error("the renderer was destroyed"), false);
  }

  /**
   * Returns until when the order for a time is used if playback goes on at the rate of the last two
   * frames, so that it has the primitives that become active meanwhile.
   */
  private predict(ticks: number): number {
    const step = this.latest === null ? 0 : ticks - this.latest.ticks;
    const isPlaying = Math.abs(step) * this.tickSeconds < kMaxStep;
    return isPlaying ? ticks + step * (2 * this.latency + 2) : ticks;
  }

  private draw(view: View): void {
    if (this.drawer === null) return;
    const { width, height } = view.camera;
    if (!(width > 0 && height > 0)) return; // a hidden canvas
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    const drawn = this.residents.list(this.order?.keys ?? []);
    const background = this.background ?? this.sceneBackground;
    this.drawer.draw(view.camera, view.ticks, drawn, this.order?.bases ?? [], background);
  }

  /** Sends the next request, unless one is in flight or the last order is still right. */
  private requestOrder(): void {
    if (this.sorter.isBusy || this.drawer === null || this.failure !== null) return;
    const exact = this.waiting.shift() ?? null;
    const view = exact ?? this.latest;
    if (view === null) return;
    if (exact === null && this.sorted !== null && isSameOrder(view, this.sorted)) return;
    this.inFlight = exact;
    this.sorted = view;
    this.rendersAtRequest = this.renders;
    this.sorter.sort(requestOf(view));
  }

  /** Takes over an order that has arrived. */
  private adopt(order: Order, milliseconds: number): void {
    if (this.order !== null) this.sorter.recycle(this.order.buffer);
    this.order = order;
    this.statistics.visible = order.count;
    this.statistics.sortMs = milliseconds;
    this.latency = Math.min(kMaxLatency, this.renders - this.rendersAtRequest);
    this.release();
    this.uploadOrder();
    const exact = this.inFlight;
    this.inFlight = null;
    const isDrawable = this.drawer !== null && !this.isOutdated;
    this.isOutdated = false;
    if (exact !== null && !isDrawable) {
      this.waiting.unshift(exact); // the context was lost
    } else if (exact !== null) {
      this.draw(exact);
      exact.resolve();
    } else {
      this.drawSoon();
    }
    this.requestOrder();
  }

  /** Draws the latest view in the new order, unless the caller renders in the same frame anyway. */
  private drawSoon(): void {
    const renders = this.renders;
    requestAnimationFrame(() => {
      if (this.renders === renders && this.latest !== null) this.draw(this.latest);
    });
  }

  private uploadOrder(): void {
    if (this.drawer === null || this.order === null) return;
    const { buffer, count, keys, bases } = this.order;
    const primitives = this.residents.list(keys).map((resident) => resident.primitives);
    this.drawer.setOrder(new Uint32Array(buffer, 0, count), primitives, bases);
  }

  private release(): void {
    this.residents.release(this.order?.keys ?? [], this.drawer?.atlas ?? null);
  }

  private fail(error: Error, reports = true): void {
    this.failure ??= error;
    if (reports) this.onError(error);
    for (const exact of this.waiting.splice(0)) exact.reject(error);
    this.inFlight?.reject(error);
    this.inFlight = null;
  }

  private readonly onLost = (event: Event): void => {
    event.preventDefault(); // so that the context is restored
    this.drawer = null;
    this.residents.forgetRows();
  };

  private readonly onRestored = (): void => {
    targetFormat(this.gl, this.format); // extensions are lost as well
    this.drawer = new FrameDrawer(this.gl, this.format);
    this.uploadOrder();
    if (this.restores) this.sorter.requestWords();
    this.isOutdated = this.sorter.isBusy;
    this.sorted = null; // the order that follows the words shows them
    this.requestOrder();
  };

  private restoreWords(key: number, words: ArrayBuffer): void {
    const resident = this.residents.at(key);
    if (resident === null || resident.rows !== null || this.drawer === null) return;
    try {
      resident.rows = this.drawer.atlas.add(new Uint32Array(words));
    } catch (error) {
      this.onError(error as Error);
    }
  }
}

/**
 * Creates a renderer for a canvas without another context. The canvas takes the size of the camera
 * of each frame, whole pixels. Throws an Error if WebGL2 is not available.
 *
 * In `statistics`, `primitives` are those of all segments that were added, and `visible` those of
 * the current order, which are active at its time or, during playback, become active soon. While
 * the GPU context is lost, nothing is drawn, renderExactly() does not resolve, and readPixels()
 * returns no pixels.
 */
export function createWebGl2Renderer(
  canvas: HTMLCanvasElement, options: WebGl2Options = {},
): Renderer {
  const gl = canvas.getContext("webgl2", {
    alpha: true, antialias: false, depth: false, stencil: false,
    powerPreference: "high-performance",
  });
  if (gl === null) {
    throw new Error("WebGL2 is not available; use a browser with hardware acceleration");
  }
  return new WebGl2Renderer(canvas, gl, options);
}
