// SPDX-License-Identifier: Apache-2.0
// Renders when the image changes, and sleeps otherwise.
import { Camera, Renderer } from "../types";
import { sameCamera } from "./fit_camera";
import { Host } from "./host";

const FPS_WINDOW = 1000; // milliseconds over which frames are counted

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
}

/**
 * Renders at the rate of the display while the time or the camera changes. Then it renders one more
 * frame in the exact order of depth, since `Renderer.render` may use an older order, and stops.
 */
export class FrameLoop {
  private source: CameraSource | null = null;
  private size: { width: number; height: number } | null = null;
  private frame: number | null = null;
  private isDirty = false;
  private isExact = false;
  private isSuspended = false;
  private isDestroyed = false;
  private last: { camera: Camera; ticks: number } | null = null;
  private readonly rendered: number[] = []; // times of the last frames

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly renderer: Renderer,
    private readonly host: Host,
    private readonly client: FrameClient,
  ) {}

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
    this.size = { width: Math.max(1, Math.round(width)), height: Math.max(1, Math.round(height)) };
    this.request();
  }

  /** Frames rendered in the last second. */
  framesPerSecond(): number {
    this.forgetFrames(this.host.now());
    return this.rendered.length;
  }

  /** Renders the current time exactly. Rejects if there is nothing to render. */
  async renderExactly(): Promise<void> {
    const time = this.client.frameTime(this.host.now());
    if (time === null || this.source === null) {
      const message = "no scene is open; wait for loadedmetadata";
      throw new DOMException(message, "InvalidStateError");
    }
    this.applySize();
    const camera = this.source.camera(this.canvas.width, this.canvas.height);
    await this.renderer.renderExactly(camera, time.ticks);
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

  /** Counts a frame that was rendered elsewhere. */
  countFrame(): void {
    this.count(this.host.now());
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
    const time = this.client.frameTime(now);
    if (this.isDestroyed || time === null || this.source === null) return;
    const moving = this.source.update(now);
    this.applySize();
    const camera = this.source.camera(this.canvas.width, this.canvas.height);
    const changed = this.isDirty || this.last === null || time.ticks !== this.last.ticks ||
      !sameCamera(camera, this.last.camera);
    if (changed) {
      this.draw(camera, time.ticks, now);
    } else if (!this.isExact && !time.running) {
      this.drawExactly(camera, time.ticks);
    }
    if (changed || moving || time.running) this.request();
  }

  private draw(camera: Camera, ticks: number, now: number): void {
    this.isDirty = false;
    this.isExact = false;
    this.last = { camera, ticks };
    try {
      this.renderer.render(camera, ticks);
    } catch (error) {
      this.client.onRenderError(error);
      return;
    }
    this.count(now);
  }

  private count(now: number): void {
    this.rendered.push(now);
    this.forgetFrames(now);
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

  private applySize(): void {
    if (this.size === null) return;
    const { width, height } = this.size;
    this.size = null;
    if (this.canvas.width === width && this.canvas.height === height) return;
    this.canvas.width = width;
    this.canvas.height = height;
    this.isDirty = true;
  }

  private forgetFrames(now: number): void {
    while (this.rendered.length > 0 && now - this.rendered[0] >= FPS_WINDOW) this.rendered.shift();
  }
}
