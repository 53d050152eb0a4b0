// SPDX-License-Identifier: Apache-2.0
// The player: the interface of a media element over a worker that decodes and a renderer.
import { Renderer, SceneInfo } from "../types";
import { abortError, PlayerError, textOf, unsupported } from "./errors";
import { EventQueue } from "./event_queue";
import { fitCamera, startCameraOf } from "./fit_camera";
import { CameraSource, FrameLoop } from "./frame_loop";
import { browserHost, Host } from "./host";
import { Playback } from "./playback";
import { Ready } from "./playback_context";
import { BufferedRanges } from "./ranges";
import { Waiters } from "./session";
import { WorkerSource } from "./worker_link";

const MIN_RATE = -2, MAX_RATE = 4; // of the core
const MEMORY_BUDGET = 512 * 2 ** 20; // bytes
const LOOK_AHEAD = 10; // seconds

export interface PlayerOptions {
  canvas: HTMLCanvasElement;
  /** Belongs to the player, which destroys it. */
  renderer: Renderer;
  /**
   * Belongs to the player, which terminates it. With a function, each load gets a worker of its
   * own, so that no message of an earlier source can be taken for one of the next.
   */
  worker: WorkerSource;
  /** Bytes for fetched and decoded data; default 512 MiB. */
  memoryBudget?: number;
  /** Seconds to fetch ahead; default 10. */
  lookAhead?: number;
  /** Default: that of the page. */
  host?: Host;
}

/** Figures for display. */
export interface PlayerStats {
  framesPerSecond: number;
  primitives: number; // of the last frame, before culling
  visible: number;
  bytesFetched: number;
  sortMs: number;
  computeMs?: number; // see RendererStatistics
  rasterMs?: number;
  layers: number; // available at the current time
  layerCount: number;
}

/**
 * Plays one source at a time, with the properties and events of `HTMLMediaElement`; times are in
 * seconds. Events are dispatched after the call that causes them. `timeupdate` is dispatched at
 * most four times per second during playback, and once after each seek, pause and end. A `notice`
 * event with `detail: { kind, message }` passes on events of the core, such as data that could not
 * be read.
 */
export class StgsPlayer extends EventTarget {
  static readonly HAVE_NOTHING = Ready.Nothing;
  /** The duration, the bounds and the start camera are known. */
  static readonly HAVE_METADATA = Ready.Metadata;
  /** The current image is available; playback has to wait for data. */
  static readonly HAVE_CURRENT_DATA = Ready.CurrentData;
  /** Playback can continue. */
  static readonly HAVE_ENOUGH_DATA = Ready.EnoughData;

  private readonly canvas: HTMLCanvasElement;
  private readonly renderer: Renderer;
  private readonly events = new EventQueue(this);
  private readonly playback: Playback;
  private readonly frames: FrameLoop;
  private source: CameraSource | null = null;
  private isDestroyed = false;
  private readonly screenshots = new Set<Waiters>(); // in flight

  constructor(options: PlayerOptions) {
    super();
    this.canvas = options.canvas;
    this.renderer = options.renderer;
    const host = options.host ?? browserHost();
    this.playback = new Playback({
      worker: options.worker,
      renderer: options.renderer,
      host,
      events: this.events,
      options: {
        memoryBudget: options.memoryBudget ?? MEMORY_BUDGET,
        lookAhead: options.lookAhead ?? LOOK_AHEAD,
      },
      onOpened: () => this.applySource(),
      onTime: () => this.frames.request(),
      onContent: () => this.frames.invalidate(),
    });
    this.frames = new FrameLoop(this.canvas, this.renderer, host, {
      onFrame: () => this.playback.updateTime(false),
      frameTime: () => this.playback.frameTime(),
      onRenderError: (error) => this.failRendering(error),
    });
    this.renderer.onError = (error) => this.failRendering(error);
  }

  /** The URL of the source; empty if there is none or it is a `Blob`. Assigning it calls `load`. */
  get src(): string {
    const { source } = this.playback;
    return typeof source === "string" ? source : "";
  }
  set src(source: string) {
    this.load(source).catch(() => undefined); // the error event reports it
  }

  /**
   * Opens a source and ends the previous one. Resolves with `loadedmetadata`. Rejects with a
   * `PlayerError`, or with an `AbortError` after an abort, another `load` or `destroy`.
   */
  load(source: string | Blob, { signal }: { signal?: AbortSignal } = {}): Promise<void> {
    if (this.isDestroyed) return Promise.reject(abortError("the player is destroyed"));
    return this.playback.load(source, signal);
  }

  /** Ends the source; the player is as new, except for its rate, its loop and its camera. */
  unload(): void {
    if (!this.isDestroyed) this.playback.unload(abortError("the source was removed"));
  }

  /**
   * Starts playback, from the beginning if it has ended. Resolves when the time advances. Rejects
   * with an `AbortError` if `pause`, `load` or `destroy` comes first, with a `NotSupportedError` if
   * the source fails.
   */
  play(): Promise<void> {
    if (this.isDestroyed) return Promise.reject(abortError("the player is destroyed"));
    return this.playback.play();
  }

  pause(): void {
    if (!this.isDestroyed) this.playback.pause();
  }

  /** Seconds. Assigning it seeks; before the scene is open, it sets the time to start at. */
  get currentTime(): number {
    return this.playback.currentTime;
  }
  set currentTime(seconds: number) {
    if (!Number.isFinite(seconds)) throw new TypeError(`currentTime ${seconds} is not finite`);
    if (!this.isDestroyed) this.playback.seekTo(seconds);
  }

  /** Seconds; NaN before `loadedmetadata`. */
  get duration(): number {
    return this.playback.scene?.duration ?? NaN;
  }
  get buffered(): BufferedRanges {
    return this.playback.scene?.buffered ?? new BufferedRanges([]);
  }
  get paused(): boolean {
    return this.playback.paused;
  }
  get ended(): boolean {
    return this.playback.ended;
  }
  get seeking(): boolean {
    return this.playback.seeking;
  }
  /** One of the HAVE_ constants. */
  get readyState(): number {
    return this.playback.ready;
  }
  get error(): PlayerError | null {
    return this.playback.error;
  }
  /**
   * Whether a source is being loaded or played: not before `load`, nor after an error or an abort.
   */
  get hasSource(): boolean {
    return this.playback.hasSource;
  }
  /** The description of the scene; null before `loadedmetadata`. */
  get info(): SceneInfo | null {
    return this.playback.scene?.info ?? null;
  }

  /** -2 to 4, not 0; negative rates play backwards. Others throw a `NotSupportedError`. */
  get playbackRate(): number {
    return this.playback.rate;
  }
  set playbackRate(rate: number) {
    if (!(rate >= MIN_RATE && rate <= MAX_RATE && rate !== 0)) {
      throw unsupported(`playbackRate ${rate} is out of range (expected -2 to 4, not 0)`);
    }
    if (!this.isDestroyed) this.playback.setRate(rate);
  }

  get loop(): boolean {
    return this.playback.loop;
  }
  set loop(loop: boolean) {
    if (!this.isDestroyed) this.playback.setLoop(loop);
  }

  get stats(): PlayerStats {
    const { bytes = 0, layers = 0, layerCount = 0 } = this.playback.scene ?? {};
    return {
      framesPerSecond: this.frames.framesPerSecond(),
      ...this.renderer.statistics,
      bytesFetched: bytes, layers, layerCount,
    };
  }

  /** The renderer in use; null while it is being loaded, and if there is none. */
  get activeRenderer(): "webgl2" | "webgpu" | null {
    return this.renderer.name;
  }

  /** Supplies the cameras; null (default): the start camera of the scene. */
  get cameraSource(): CameraSource | null {
    return this.source;
  }
  set cameraSource(source: CameraSource | null) {
    this.source = source;
    this.applySource();
  }

  /** Renders a frame if the time or the camera has changed; call it after moving the camera. */
  requestFrame(): void {
    this.frames.request();
  }

  /** Sets the size of the canvas, pixels. */
  resize(width: number, height: number): void {
    this.frames.resize(width, height);
  }

  /** Returns the current image as PNG, rendered in the exact order. */
  async screenshot(): Promise<Blob> {
    if (this.isDestroyed) throw abortError("the player is destroyed");
    const end = new Waiters();
    this.screenshots.add(end);
    try {
      await Promise.race([this.frames.renderExactly(), end.wait()]);
    } finally {
      this.screenshots.delete(end);
    }
    // The drawing buffer is valid until this task ends; toBlob copies it before it returns.
    return new Promise((resolve, reject) => {
      this.canvas.toBlob((blob) => {
        if (blob !== null) resolve(blob);
        else reject(new DOMException("the canvas could not be encoded as PNG", "EncodingError"));
      }, "image/png");
    });
  }

  /** Ends everything: the worker, the renderer and pending promises. No event follows. */
  destroy(): void {
    if (this.isDestroyed) return;
    this.isDestroyed = true;
    this.events.close();
    this.frames.destroy();
    this.playback.destroy();
    for (const end of this.screenshots) end.reject(abortError("the player was destroyed"));
    this.renderer.destroy();
  }

  private failRendering(error: unknown): void {
    this.playback.fail("unsupported", `rendering failed: ${textOf(error)}`);
  }

  private applySource(): void {
    const { info } = this;
    if (info === null) return;
    const start = startCameraOf(info);
    const fixed: CameraSource = { update: () => false, camera: (w, h) => fitCamera(start, w, h) };
    this.frames.setSource(this.source ?? fixed);
  }
}
