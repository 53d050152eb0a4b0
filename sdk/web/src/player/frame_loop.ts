// SPDX-License-Identifier: Apache-2.0
// Renders when the image changes, and sleeps otherwise.
import { Camera, Renderer } from "../types";
import { sameCamera } from "./fit_camera";
import { FrameRate } from "./frame_rate";
import { Host } from "./host";

const RECENT_SIZES = 4;

interface Size {
  width: number;
  height: number;
}

function isSize(size: Size, { width, height }: Size): boolean {
  return size.width === width && size.height === height;
}

/** Supplies the camera of each frame. */
export interface CameraSource {
  /**
   * Advances to `now`, milliseconds of any fixed clock. Returns whether the camera moves by itself.
   */
  update(now: number): boolean;
  /** The camera for an image of this size in pixels. */
  camera(width: number, height: number): Camera;
}

/** Supplies the time of each frame. */
export interface FrameClient {
  /** Called at the beginning of each frame. */
  onFrame(now: number): void;
  /** The time to render, ticks, and whether it advances; null: there is nothing to render. */
  frameTime(now: number): { ticks: number; running: boolean } | null;
  onRenderError(error: unknown): void;
  /** A frame was drawn while the image changes. */
  onDrawn(now: number): void;
  /** Nothing is drawn until something changes. */
  onIdle(): void;
  /** The size of images cannot be changed, see `setScale`. */
  onFixedSize(): void;
}

/**
 * Renders at the rate of the display while the time or the camera changes. Then it renders one more
 * frame in the exact order of depth, since `Renderer.render` may use an older order, and stops.
 */
export class FrameLoop {
  private source: CameraSource | null = null;
  private requested: Size | null = null; // by resize(), since the last frame
  private full: Size; // of still images
  private scale = 1;
  private scaled: Size; // of images while they change
  private readonly recent: Size[] = []; // of images; a renderer that is behind resizes the canvas later
  private layout: Size | null = null; // on the page, before the canvas takes the size `scaled`
  private frame: number | null = null;
  private isDirty = false;
  private isExact = false;
  private isSuspended = false;
  private isDestroyed = false;
  private last: { camera: Camera; ticks: number } | null = null;
  private readonly rate = new FrameRate();
  private drawn = 0; // frames, by renderers that do not count them

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly renderer: Renderer,
    private readonly host: Host,
    private readonly client: FrameClient,
  ) {
    this.full = this.scaled = { width: canvas.width, height: canvas.height };
    this.remember(this.full);
  }

  /** The source must stay valid until it is replaced or the loop is destroyed. */
  setSource(source: CameraSource): void {
    this.source = source;
    this.request();
  }

  /** Requests a frame, which is rendered if the time or the camera differs. */
  request(): void {
    if (this.frame !== null || this.isSuspended || this.isDestroyed) return;
    this.frame = this.host.requestFrame(() => {
      this.frame = null;
      this.step();
    });
  }

  /** Requests that the next frame is rendered, for its content changed. */
  invalidate(): void {
    this.isDirty = true;
    this.request();
  }

  /** Sets the size of the canvas in pixels with the next frame, so that it is never seen empty. */
  resize(width: number, height: number): void {
    this.layout = null; // the page has changed it
    this.requested = { width: Math.max(1, Math.round(width)), height: Math.max(1, Math.round(height)) };
    this.request();
  }

  /**
   * Scales the width and height of the image while it changes. `scale` is above 0 and at most 1. Still images
   * have the full size. If the size of the canvas on the page depends on its pixels, the scale stays 1, and
   * `onFixedSize` is called.
   */
  setScale(scale: number): void {
    if (scale === this.scale) return;
    this.scale = scale;
    this.request();
  }

  /** Number of frames that the renderer has completed. */
  get completed(): number {
    return this.renderer.statistics.frames ?? this.drawn;
  }

  /** Frames completed in the last second. */
  framesPerSecond(): number {
    this.rate.add(this.host.now(), this.completed);
    return this.rate.framesPerSecond;
  }

  /** Renders the current time exactly. Rejects if there is nothing to render. */
  async renderExactly(): Promise<void> {
    const time = this.client.frameTime(this.host.now());
    if (time === null || this.source === null) {
      throw new DOMException("there is no image yet; wait for loadeddata", "InvalidStateError");
    }
    this.findSize();
    await this.renderer.renderExactly(this.stillCamera(this.source), time.ticks);
  }

  /** Renders nothing until `resume`, while a headset shows the scene. */
  suspend(): void {
    this.isSuspended = true;
    this.cancel();
  }

  resume(): void {
    this.isSuspended = false;
    this.invalidate();
  }

  /** Counts a frame that was drawn. */
  countFrame(): void {
    if (this.renderer.statistics.frames === undefined) ++this.drawn;
    this.rate.add(this.host.now(), this.completed);
  }

  destroy(): void {
    this.isDestroyed = true;
    this.cancel();
  }

  private cancel(): void {
    if (this.frame !== null) this.host.cancelFrame(this.frame);
    this.frame = null;
  }

  private step(): void {
    const now = this.host.now();
    this.client.onFrame(now);
    if (this.isDestroyed || this.source === null || this.client.frameTime(now) === null) return;
    const moving = this.source.update(now);
    const size = this.nextSize();
    // Resizing a canvas can take a tenth of a second.
    const time = this.client.frameTime(this.host.now());
    if (time === null) return;
    const camera = this.source.camera(size.width, size.height);
    const changed = this.isDirty || this.last === null || time.ticks !== this.last.ticks ||
      !sameCamera(camera, this.last.camera);
    if (changed) {
      this.draw(camera, time.ticks);
    } else if (!this.isExact && !time.running) {
      this.drawExactly(this.stillCamera(this.source), time.ticks);
    }
    if (changed || moving || time.running) this.request();
    // A renderer that is being loaded draws the newest frame later.
    if (changed && this.renderer.name !== null) this.client.onDrawn(now);
    else if (!moving && !time.running) this.client.onIdle();
  }

  private draw(camera: Camera, ticks: number): void {
    this.isDirty = false;
    this.isExact = false;
    this.last = { camera, ticks };
    try {
      this.renderer.render(camera, ticks);
    } catch (error) {
      this.client.onRenderError(error);
      return;
    }
    if (this.renderer.name !== null) this.countFrame();
  }

  private drawExactly(camera: Camera, ticks: number): void {
    this.isExact = true;
    this.renderer.renderExactly(camera, ticks).then(
      () => {
        // A frame rendered in the meantime is newer than this one.
        if (!this.isExact) this.invalidate();
      },
      (error) => {
        if (!this.isDestroyed) this.client.onRenderError(error);
      },
    );
  }

  /** Updates the full size: the requested one, or the one that the page has set on the canvas. */
  private findSize(): void {
    const { canvas, requested, full } = this;
    this.checkLayout();
    const isOwn = this.recent.some((size) => isSize(size, canvas));
    const { width, height } = requested ?? (isOwn ? full : canvas);
    this.requested = null;
    if (isSize(full, { width, height })) return;
    this.full = this.scaled = { width, height };
    this.remember(this.full);
    this.layout = null;
    this.isDirty = true;
  }

  /** The size of the image while it changes. */
  private scaledSize(): Size {
    const { width, height } = this.full;
    if (this.scale === 1) return this.full;
    return { width: Math.max(1, Math.round(this.scale * width)), height: Math.max(1, Math.round(this.scale * height)) };
  }

  /** Returns the size of the next changing image, and prepares the canvas for it. */
  private nextSize(): Size {
    this.findSize();
    const size = this.scaledSize();
    if (this.isDirty || this.last === null || !isSize(this.last.camera, size)) this.adoptSize(size);
    return size;
  }

  /** Prepares the canvas. A renderer makes it smaller when it draws. */
  private adoptSize(size: Size): void {
    const { canvas } = this;
    if (size === this.full) this.setFullSize();
    else if (!isSize(this.scaled, size)) this.layout = { width: canvas.clientWidth, height: canvas.clientHeight };
    this.scaled = size;
    this.remember(size);
  }

  private remember(size: Size): void {
    if (this.recent.some((one) => isSize(one, size))) return;
    this.recent.push(size);
    if (this.recent.length > RECENT_SIZES) this.recent.shift();
  }

  /** Ends scaling if the size of the canvas on the page follows its pixels. */
  private checkLayout(): void {
    const { canvas, layout } = this;
    if (layout === null || !isSize(this.scaled, canvas)) return;
    this.layout = null;
    const now = { width: canvas.clientWidth, height: canvas.clientHeight };
    const follows = now.width === canvas.width || now.height === canvas.height;
    if (isSize(layout, now) || !follows) return; // otherwise, the page has changed it
    this.scale = 1;
    this.isDirty = true;
    this.client.onFixedSize();
  }

  /** The camera for an image of the full size. */
  private stillCamera(source: CameraSource): Camera {
    if (this.scaledSize() === this.full) this.setFullSize();
    return source.camera(this.full.width, this.full.height);
  }

  private setFullSize(): void {
    const { canvas, full } = this;
    if (isSize(full, canvas)) return;
    canvas.width = full.width;
    canvas.height = full.height;
  }
}
