// SPDX-License-Identifier: Apache-2.0
import { checkWords, padded } from "../packed_segment";
import type { Camera, PackedSegment, SceneInfo } from "../types";
import { OrderTextures } from "./order_textures";
import { Residents } from "./residents";
import { kSorterBytes } from "./sorter";
import type { Order } from "./sorter";
import { SorterClient } from "./sorter_client";
import { SplatDrawer } from "./splat_drawer";
import type { SplatOutput } from "./splat_drawer";
import { ViewOrder, viewOf } from "./view_order";
import type { View } from "./view_order";

/** How a scene works in a WebGL context. */
export interface SplatSceneOptions {
  /** Of stgs-sorter.js. */
  sorterUrl: string | URL;
  /** Whether the worker retains all words, to restore them after the context was lost. */
  restoresContext: boolean;
  /** Whether outputs have a second image, for the sums of depths. Default: false. */
  hasDepth?: boolean;
  /** Receives failures that no call can report, as of the worker. */
  report(error: Error): void;
  /** A new order has arrived: the image of the last follow() may have changed. */
  onOrder(): void;
  /** Runs calls of WebGL that happen outside of drawing. Default: calls `work`. */
  guard?: <T>(work: () => T) => T;
}

interface ExactView extends View {
  draw: () => void;
  resolve: () => void;
  reject: (error: Error) => void;
}

/**
 * The segments of a scene in a WebGL context, and their orders by depth, one per view. It draws
 * splats into any framebuffer; its owner decides which, and passes on that the context is lost and
 * restored.
 */
export class SplatScene {
  /** Those of `SegmentSink`. */
  readonly statistics = { primitives: 0, visible: 0, sortMs: 0 };
  private readonly sorter: SorterClient;
  private readonly guard: <T>(work: () => T) => T;
  private readonly residents = new Residents();
  private drawer: SplatDrawer | null; // null while the context is lost
  private orders: [ViewOrder, ...ViewOrder[]] = [new ViewOrder()];
  private failure: Error | null = null; // of the sorter; final
  private tickSeconds = 1 / 30;
  private kernel = 0; // of the splats
  private requested = 0; // number of the view whose order was requested last
  private inFlight: { target: ViewOrder; exact: ExactView | null } | null = null;
  private isOutdated = false; // the reply in flight precedes the restored words
  private readonly waiting: ExactView[] = [];

  /** Creates the GPU objects and the worker. Throws an Error if a shader cannot be built. */
  constructor(
    private readonly gl: WebGL2RenderingContext, private readonly options: SplatSceneOptions,
  ) {
    this.guard = options.guard ?? ((work) => work());
    this.drawer = this.guard(() => new SplatDrawer(gl, options.hasDepth ?? false));
    this.createTextures();
    this.sorter = new SorterClient(options.sorterUrl, {
      onOrder: (order, milliseconds) => this.adopt(order, milliseconds),
      onWords: (key, words) => this.restoreWords(key, words),
      onFailure: (message) => this.fail(new Error(message)),
    });
  }

  /** Removes all segments: those of another scene have other ids. */
  setScene(info: SceneInfo): void {
    this.tickSeconds = info.tickSeconds;
    this.kernel = info.kernel;
    for (const id of this.residents.ids()) this.removeSegment(id);
    this.residents.clear(); // the current order does not show those that it still names
  }

  addSegment(segment: PackedSegment): void {
    checkWords(segment);
    const rows = this.upload(segment.words);
    this.removeSegment(segment.id);
    const resident = this.residents.add(segment);
    resident.rows = rows;
    const { key, id, primitives, begin, end, origin } = resident;
    const words = this.options.restoresContext
      ? segment.words
      : segment.words.slice(0, kSorterBytes * padded(primitives));
    this.sorter.add({ key, id, primitives, begin, end, origin, words });
    this.expireOrders();
    this.statistics.primitives = this.residents.primitives;
  }

  removeSegment(id: number): void {
    const resident = this.residents.remove(id);
    if (resident === null) return;
    this.sorter.remove(resident.key);
    this.expireOrders();
    this.statistics.primitives = this.residents.primitives;
    if (!this.sorter.isBusy) this.release();
  }

  /** Sets how many views have an order of their own; at first, it is one. */
  setViews(count: number): void {
    if (count === this.orders.length) return;
    const [first, ...others] = this.orders;
    const added = Array.from({ length: Math.max(0, count - 1 - others.length) },
                             () => new ViewOrder());
    const dropped = others.splice(count - 1);
    this.orders = [first, ...others, ...added];
    this.guard(() => dropped.forEach((view) => view.textures?.destroy()));
    this.createTextures();
    if (!this.sorter.isBusy) this.release();
  }

  /** Requests the order of a view, once per frame that is drawn. Returns a copy of the view. */
  follow(camera: Camera, ticks: number, view = 0): View {
    const copy = this.orderOf(view).follow(camera, ticks, this.tickSeconds);
    this.requestOrder();
    return copy;
  }

  /** Resolves once `draw` has been called while the order is that of exactly this view. */
  orderExactly(camera: Camera, ticks: number, draw: (view: View) => void): Promise<void> {
    if (this.failure !== null) return Promise.reject(this.failure);
    const view = viewOf(camera, ticks, ticks);
    this.orders[0].latest = view;
    return new Promise((resolve, reject) => {
      this.waiting.push({ ...view, draw: () => draw(view), resolve, reject });
      this.requestOrder();
    });
  }

  /**
   * Blends the splats of a time into an output, in the newest order of a view. Without a GPU
   * context, it draws nothing.
   */
  draw(camera: Camera, ticks: number, output: SplatOutput, view = 0): void {
    const own = this.orderOf(view);
    const { order, textures } = own.order === null ? this.orders[0] : own;
    if (this.drawer === null || order === null || textures === null) return;
    const drawn = this.residents.list(order.keys);
    this.drawer.draw({ camera, ticks, kernel: this.kernel }, drawn, order.bases, output, textures);
  }

  /** The context is lost: its objects do not exist any more. */
  lose(): void {
    this.drawer = null;
    for (const view of this.orders) view.textures = null;
    this.residents.forgetRows();
  }

  /** The context is restored: creates its objects again, and requests the words. */
  restore(): void {
    this.drawer = this.guard(() => new SplatDrawer(this.gl, this.options.hasDepth ?? false));
    this.createTextures();
    this.orders.forEach((view) => this.uploadOrder(view));
    if (this.options.restoresContext) this.sorter.requestWords();
    this.isOutdated = this.sorter.isBusy;
    this.expireOrders(); // those that follow the words show them
    this.requestOrder();
  }

  destroy(): void {
    this.sorter.destroy();
    this.guard(() => {
      this.drawer?.destroy();
      for (const { textures } of this.orders) textures?.destroy();
    });
    this.drawer = null;
    this.orders = [new ViewOrder()];
    this.fail(new Error("the renderer was destroyed"), false);
  }

  private orderOf(view: number): ViewOrder {
    return this.orders[view] ?? this.orders[0];
  }

  private expireOrders(): void {
    for (const view of this.orders) view.expire();
  }

  private createTextures(): void {
    if (this.drawer === null) return;
    this.guard(() => {
      for (const view of this.orders) view.textures ??= new OrderTextures(this.gl);
    });
  }

  /** Sends the next request, unless one is in flight or all orders are still right. */
  private requestOrder(): void {
    if (this.sorter.isBusy || this.drawer === null || this.failure !== null) return;
    const exact = this.waiting.shift() ?? null;
    const target = exact !== null ? this.orders[0] : this.nextDue();
    const view = exact ?? target?.latest ?? null;
    if (target === null || view === null) return;
    this.inFlight = { target, exact };
    this.sorter.sort(target.request(view));
  }

  /** Returns the next view whose order is due, in turn; null: there is none. */
  private nextDue(): ViewOrder | null {
    const { length } = this.orders;
    for (let k = 1; k <= length; ++k) {
      const number = (this.requested + k) % length;
      if (!this.orderOf(number).isDue) continue;
      this.requested = number;
      return this.orderOf(number);
    }
    return null;
  }

  /** Takes over an order that has arrived. */
  private adopt(order: Order, milliseconds: number): void {
    const { target = this.orders[0], exact = null } = this.inFlight ?? {};
    if (target.order !== null) this.sorter.recycle(target.order.buffer);
    target.adopt(order);
    this.statistics.visible = order.count;
    this.statistics.sortMs = milliseconds;
    this.release();
    if (this.orders.includes(target)) this.uploadOrder(target);
    this.inFlight = null;
    if (this.failure !== null) return;
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

  private uploadOrder({ order, textures }: ViewOrder): void {
    const { drawer } = this;
    if (order === null || textures === null || drawer === null) return;
    const { buffer, count, keys, bases } = order;
    const primitives = this.residents.list(keys).map((resident) => resident.primitives);
    try {
      this.guard(() => {
        textures.upload(new Uint32Array(buffer, 0, count), primitives, bases);
        drawer.reserve(textures);
      });
    } catch (error) {
      this.fail(error as Error);
    }
  }

  private upload(words: ArrayBuffer) {
    const { drawer } = this;
    return drawer === null ? null : this.guard(() => drawer.atlas.add(new Uint32Array(words)));
  }

  private release(): void {
    const keys = this.orders.flatMap((view) => view.order?.keys ?? []);
    this.residents.release(keys, this.drawer?.atlas ?? null);
  }

  private fail(error: Error, reports = true): void {
    this.failure ??= error;
    if (reports) this.options.report(error);
    for (const exact of this.waiting.splice(0)) exact.reject(error);
    this.inFlight?.exact?.reject(error);
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
