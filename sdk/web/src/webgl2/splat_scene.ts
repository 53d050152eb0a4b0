// SPDX-License-Identifier: Apache-2.0
import type { Camera, PackedSegment, SceneInfo } from "../types";
import { Residents } from "./residents";
import { kSorterBytes, padded } from "./sorter";
import type { Order, SortRequest } from "./sorter";
import { SorterClient } from "./sorter_client";
import { SplatDrawer } from "./splat_drawer";
import type { SplatOutput } from "./splat_drawer";

/** How a scene works in a WebGL context. */
export interface SplatSceneOptions {
  /** Of sorter_worker.js. */
  sorterUrl: string | URL;
  /** Whether the worker retains all words, to restore them after the context was lost. */
  restoresContext: boolean;
  /** Receives failures that no call can report, as of the worker. */
  report(error: Error): void;
  /** A new order has arrived: what was drawn since the last call of follow() may have changed. */
  onOrder(): void;
  /** Runs calls of WebGL that happen outside of drawing. Default: calls `work`. */
  guard?: <T>(work: () => T) => T;
}

/** A camera and a time. The objects are copies: callers may change theirs. */
export interface View {
  camera: Camera;
  ticks: number;
  until: number; // ticks; the latest time, or the earliest in reverse, at which its order is used
}

interface ExactView extends View {
  draw: () => void;
  resolve: () => void;
  reject: (error: Error) => void;
}

/** Successive frames that are more seconds apart are a seek, not playback. */
const kMaxStep = 0.25;
/** Bounds how far the order looks ahead, frames. */
const kMaxLatency = 8;

/** Returns the bytes of a packed segment (packed_segment.h). */
function packedBytes(primitives: number, shDegree: number): number {
  const planes = Math.ceil((3 * (shDegree + 1) ** 2) / 4);
  return padded(primitives) * (72 + 8 * planes);
}

function requestOf({ camera, ticks, until }: View): SortRequest {
  const [x, y, z] = camera.rotation.slice(6, 9) as [number, number, number];
  const offset = camera.translation[2] as number;
  return { direction: [x, y, z], offset, near: camera.near, ticks, until };
}

function isSameOrder(a: View, b: View): boolean {
  return JSON.stringify(requestOf(a)) === JSON.stringify(requestOf(b));
}

function viewOf(camera: Camera, ticks: number, until: number): View {
  const rotation = camera.rotation.slice();
  const translation = camera.translation.slice();
  return { camera: { ...camera, rotation, translation }, ticks, until };
}

/**
 * The segments of a scene in a WebGL context, and their order by depth. It draws splats into any
 * framebuffer; its owner decides which, and passes on that the context is lost and restored.
 */
export class SplatScene {
  /** Those of `SegmentSink`. */
  readonly statistics = { primitives: 0, visible: 0, sortMs: 0 };
  private readonly sorter: SorterClient;
  private readonly guard: <T>(work: () => T) => T;
  private readonly residents = new Residents();
  private drawer: SplatDrawer | null; // null while the context is lost
  private order: Order | null = null;
  private failure: Error | null = null; // of the sorter; final
  private latest: View | null = null; // of the last call of follow() or orderExactly()
  private sorted: View | null = null; // of the newest request; null if segments changed since then
  private frames = 0; // calls of follow()
  private framesAtRequest = 0;
  private latency = 0; // of the sorter, in calls of follow()
  private tickSeconds = 1 / 30;
  private inFlight: ExactView | null = null;
  private isOutdated = false; // the reply in flight precedes the restored words
  private readonly waiting: ExactView[] = [];

  /** Creates the GPU objects and the worker. Throws an Error if a shader cannot be built. */
  constructor(
    private readonly gl: WebGL2RenderingContext, private readonly options: SplatSceneOptions,
  ) {
    this.guard = options.guard ?? ((work) => work());
    this.drawer = this.guard(() => new SplatDrawer(gl));
    this.sorter = new SorterClient(options.sorterUrl, {
      onOrder: (order, milliseconds) => this.adopt(order, milliseconds),
      onWords: (key, words) => this.restoreWords(key, words),
      onFailure: (message) => this.fail(new Error(message)),
    });
  }

  /** Removes all segments: those of another scene have other ids. */
  setScene(info: SceneInfo): void {
    this.tickSeconds = info.tickSeconds;
    for (const id of this.residents.ids()) this.removeSegment(id);
  }

  addSegment(segment: PackedSegment): void {
    const bytes = packedBytes(segment.primitives, segment.shDegree);
    if (segment.words.byteLength !== bytes) {
      throw new Error(
        `segment ${segment.id}: ${segment.words.byteLength} bytes of words (expected ${bytes} ` +
        `for ${segment.primitives} primitives of SH degree ${segment.shDegree})`);
    }
    const rows = this.upload(segment.words);
    this.removeSegment(segment.id);
    const resident = this.residents.add(segment);
    resident.rows = rows;
    const { key, id, primitives, begin, end, origin } = resident;
    const words = this.options.restoresContext
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

  /** Requests the order of a frame, once per frame that is drawn. Returns a copy of the view. */
  follow(camera: Camera, ticks: number): View {
    const view = viewOf(camera, ticks, this.predict(ticks));
    this.latest = view;
    ++this.frames;
    this.requestOrder();
    return view;
  }

  /** Resolves once `draw` has been called while the order is that of exactly this view. */
  orderExactly(camera: Camera, ticks: number, draw: (view: View) => void): Promise<void> {
    if (this.failure !== null) return Promise.reject(this.failure);
    const view = viewOf(camera, ticks, ticks);
    this.latest = view;
    return new Promise((resolve, reject) => {
      this.waiting.push({ ...view, draw: () => draw(view), resolve, reject });
      this.requestOrder();
    });
  }

  /**
   * Blends the splats of a time over the bound framebuffer, in the current viewport, in the newest
   * order. Without a GPU context, it draws nothing.
   */
  draw(camera: Camera, ticks: number, output: SplatOutput): void {
    const drawn = this.residents.list(this.order?.keys ?? []);
    this.drawer?.draw(camera, ticks, drawn, this.order?.bases ?? [], output);
  }

  /** The context is lost: its objects do not exist any more. */
  lose(): void {
    this.drawer = null;
    this.residents.forgetRows();
  }

  /** The context is restored: creates its objects again, and requests the words. */
  restore(): void {
    this.drawer = this.guard(() => new SplatDrawer(this.gl));
    this.uploadOrder();
    if (this.options.restoresContext) this.sorter.requestWords();
    this.isOutdated = this.sorter.isBusy;
    this.sorted = null; // the order that follows the words shows them
    this.requestOrder();
  }

  destroy(): void {
    this.sorter.destroy();
    this.guard(() => this.drawer?.destroy());
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

  /** Sends the next request, unless one is in flight or the last order is still right. */
  private requestOrder(): void {
    if (this.sorter.isBusy || this.drawer === null || this.failure !== null) return;
    const exact = this.waiting.shift() ?? null;
    const view = exact ?? this.latest;
    if (view === null) return;
    if (exact === null && this.sorted !== null && isSameOrder(view, this.sorted)) return;
    this.inFlight = exact;
    this.sorted = view;
    this.framesAtRequest = this.frames;
    this.sorter.sort(requestOf(view));
  }

  /** Takes over an order that has arrived. */
  private adopt(order: Order, milliseconds: number): void {
    if (this.order !== null) this.sorter.recycle(this.order.buffer);
    this.order = order;
    this.statistics.visible = order.count;
    this.statistics.sortMs = milliseconds;
    this.latency = Math.min(kMaxLatency, this.frames - this.framesAtRequest);
    this.release();
    this.uploadOrder();
    const exact = this.inFlight;
    this.inFlight = null;
    const isDrawable = this.drawer !== null && !this.isOutdated;
    this.isOutdated = false;
    if (exact !== null && !isDrawable) {
      this.waiting.unshift(exact); // the context was lost
    } else if (exact !== null) {
      exact.draw();
      exact.resolve();
    } else {
      this.options.onOrder();
    }
    this.requestOrder();
  }

  private uploadOrder(): void {
    const { drawer, order } = this;
    if (drawer === null || order === null) return;
    const { buffer, count, keys, bases } = order;
    const primitives = this.residents.list(keys).map((resident) => resident.primitives);
    this.guard(() => drawer.setOrder(new Uint32Array(buffer, 0, count), primitives, bases));
  }

  private upload(words: ArrayBuffer) {
    const { drawer } = this;
    return drawer === null ? null : this.guard(() => drawer.atlas.add(new Uint32Array(words)));
  }

  private release(): void {
    this.residents.release(this.order?.keys ?? [], this.drawer?.atlas ?? null);
  }

  private fail(error: Error, reports = true): void {
    this.failure ??= error;
    if (reports) this.options.report(error);
    for (const exact of this.waiting.splice(0)) exact.reject(error);
    this.inFlight?.reject(error);
    this.inFlight = null;
  }

  private restoreWords(key: number, words: ArrayBuffer): void {
    const resident = this.residents.at(key);
    if (resident === null || resident.rows !== null) return;
    try {
      resident.rows = this.upload(words);
    } catch (error) {
      this.options.report(error as Error);
    }
  }
}
