// SPDX-License-Identifier: Apache-2.0
// The player that draws to a canvas.
import { Renderer, RendererStatistics } from "../types";
import { XrMode, XrOptions, XrPresenter } from "../xr/presenter";
import type { QualityReport } from "./adaptation";
import { abortError, isDeviceLost, textOf } from "./errors";
import { fitCamera, startCameraOf } from "./fit_camera";
import { CameraSource, FrameLoop } from "./frame_loop";
import { browserHost, Host } from "./host";
import { resume } from "./resume";
import { ScenePlayer, ScenePlayerOptions } from "./scene_player";
import { Waiters } from "./session";

/** Settings of a `StgsPlayer`. */
export interface PlayerOptions extends ScenePlayerOptions {
  canvas: HTMLCanvasElement;
  /** Belongs to the player, which destroys it. */
  renderer: Renderer;
  /** Default: that of the page. */
  host?: Host;
}

/** Figures for display. */
export interface PlayerStats extends RendererStatistics {
  framesPerSecond: number; // completed in the last second
  bytesFetched: number;
  bytesPerSecond: number; // recent throughput, on which the fetched layers depend; 0: not known yet
  memoryBytes: number; // of fetched and decoded segments; at most the memory budget
  layers: number; // available at the current time
  layerCount: number;
  quality: QualityReport | null; // null: there is no player
}

/** Statistics without a player. */
export const NO_STATS: PlayerStats = {
  framesPerSecond: 0, primitives: 0, visible: 0, bytesFetched: 0, bytesPerSecond: 0, memoryBytes: 0,
  sortMs: 0, layers: 0, layerCount: 0, quality: null,
};

function contextLost(): DOMException {
  return new DOMException("the WebGL2 context is lost; repeat the screenshot once the scene is drawn again", "InvalidStateError");
}

/**
 * Plays on a canvas: see `ScenePlayer`. The events `enterxr` and `leavexr` report sessions. When a WebGPU device
 * is lost for the first time since load(), the player dispatches a `notice` of the kind `renderer`, reloads
 * the source with another renderer, and resumes at the same time. After the loss of a WebGL2 context, nothing is
 * drawn until the browser restores it; no event reports that.
 */
export class StgsPlayer extends ScenePlayer {
  private readonly canvas: HTMLCanvasElement;
  private readonly renderer: Renderer;
  private readonly frames: FrameLoop;
  private readonly xr: XrPresenter;
  private source: CameraSource | null = null;
  private readonly screenshots = new Set<Waiters>(); // in flight
  private lost: Error | null = null; // the first loss of the GPU since load()
  private hasLostDevice = false; // ever
  private isWithoutRenderer = false;

  constructor(options: PlayerOptions) {
    const host = options.host ?? browserHost();
    super(options, {
      sink: options.renderer,
      host,
      onOpened: () => {
        this.limitPrimitives();
        this.applySource();
      },
      onTime: () => this.frames.request(),
      onContent: () => this.frames.invalidate(),
      onQuality: () => this.frames.setScale(this.adaptation.scale),
    });
    this.canvas = options.canvas;
    this.renderer = options.renderer;
    const client = {
      onFrame: () => this.playback.updateTime(false),
      onDrawn: (now: number) => this.adaptation.frame(now, this.frames.completed),
      onIdle: () => this.adaptation.pause(),
      onFixedSize: () => this.adaptation.fixResolution(),
      frameTime: () => this.playback.frameTime(),
      onRenderError: (error: unknown) => this.failRendering(error),
    };
    this.frames = new FrameLoop(this.canvas, this.renderer, host, client);
    this.xr = new XrPresenter(this.renderer, {
      ...client,
      info: () => this.info,
      onDrawn: () => {
        this.frames.countFrame();
        client.onDrawn(host.now());
      },
      onSelect: () => this.toggle(),
      onStart: () => {
        this.frames.suspend();
        this.adaptation.setXr(true);
        this.events.push("enterxr");
      },
      onEnd: () => {
        this.adaptation.setXr(false);
        this.frames.resume();
        this.events.push("leavexr");
      },
    });
    this.frames.setScale(this.adaptation.scale);
    this.renderer.onError = (error) => this.failRendering(error);
  }

  get stats(): PlayerStats {
    const { bytes = 0, bytesPerSecond = 0, memory = 0, layers = 0, layerCount = 0 } = this.playback.scene ?? {};
    return {
      framesPerSecond: this.frames.framesPerSecond(),
      ...this.renderer.statistics,
      bytesFetched: bytes, bytesPerSecond, memoryBytes: memory, layers, layerCount,
      quality: this.qualityReport,
    };
  }

  /** The renderer in use; null while it is being loaded, and if there is none. */
  get activeRenderer(): "webgl2" | "webgpu" | null {
    return this.renderer.name;
  }

  /**
   * Whether playback ended because the GPU was lost again, or because no renderer could be created after
   * the first loss. A player on another canvas may still be able to draw with WebGL2.
   */
  get hasLostRenderer(): boolean {
    return this.isWithoutRenderer;
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

  /**
   * Returns the current image as PNG, rendered in the exact order. Rejects with an `InvalidStateError` before
   * `loadeddata` and while the WebGL2 context is lost.
   */
  async screenshot(): Promise<Blob> {
    if (this.isDestroyed) throw abortError("the player is destroyed");
    if (this.renderer.views?.context.isContextLost()) throw contextLost();
    const end = new Waiters();
    const onLost = () => end.reject(contextLost());
    this.screenshots.add(end);
    this.canvas.addEventListener("webglcontextlost", onLost);
    try {
      await Promise.race([this.frames.renderExactly(), end.wait()]);
    } finally {
      this.canvas.removeEventListener("webglcontextlost", onLost);
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

  /**
   * Shows the scene in a headset. Call it in a handler of a click or a key. Resolves when the
   * session begins. Rejects with a `NotSupportedError` if the browser, the device or the renderer
   * cannot, with an `InvalidStateError` before `loadedmetadata`, while the renderer is being loaded or while a
   * session is active or requested, with an `AbortError` if `load`, `unload`, `exitXR` or `destroy` comes first,
   * and otherwise with the error of the browser if the user declines.
   */
  enterXR(mode: XrMode = "immersive-vr", options: XrOptions = {}): Promise<void> {
    if (this.isDestroyed) return Promise.reject(abortError("the player is destroyed"));
    return this.xr.enter(mode, options);
  }

  /**
   * Ends the session, also a requested one. Resolves once there is none: while the browser asks the user, after the
   * answer.
   */
  exitXR(): Promise<void> {
    return this.xr.exit();
  }

  /** Whether the scene is shown in a headset. */
  get isInXR(): boolean {
    return this.xr.isActive;
  }

  /** Resolves to whether `enterXR` with this mode is possible in this browser and on its devices. */
  supportsXR(mode: XrMode = "immersive-vr"): Promise<boolean> {
    return this.xr.supports(mode);
  }

  override load(source: string | Blob, options: { signal?: AbortSignal } = {}): Promise<void> {
    this.xr.exit(); // its room is that of the last scene
    this.lost = null;
    this.isWithoutRenderer = false;
    return super.load(source, options);
  }

  override unload(): void {
    this.xr.exit();
    super.unload();
  }

  override destroy(): void {
    if (this.isDestroyed) return;
    this.frames.destroy();
    this.xr.destroy();
    super.destroy();
    for (const end of this.screenshots) end.reject(abortError("the player was destroyed"));
  }

  private toggle(): void {
    if (this.paused) this.play().catch(() => undefined); // the error event reports failures
    else this.pause();
  }

  private failRendering(error: unknown): void {
    const isLost = isDeviceLost(error);
    if (isLost) this.hasLostDevice = true;
    if (isLost && (this.lost ?? error) === error) {
      if (this.lost === null) this.recover(error);
      return;
    }
    if (this.error === null) {
      // A renderer that could not be created has no name.
      this.isWithoutRenderer = this.hasLostDevice && (isLost || this.renderer.name === null);
    }
    this.playback.fail("unsupported", `rendering failed: ${textOf(error)}`);
  }

  /** Reloads the source with a renderer on another device. */
  private recover(error: Error): void {
    const { source } = this.playback;
    // A scene that is not open yet, or the next source, has another device anyway.
    if (this.isDestroyed || this.error !== null || source === null || this.info === null) return;
    this.lost = error;
    this.events.push("notice", { kind: "renderer", message: error.message });
    const { currentTime, paused, live } = this;
    resume(this, super.load(source), { currentTime, paused, live });
  }

  /** Applies the limit of the renderer once it is loaded. */
  private limitPrimitives(): void {
    const adopt = () => this.adaptation.limitRenderer(this.renderer.maxPrimitives ?? Infinity);
    if (this.renderer.whenReady === undefined) return adopt();
    void this.renderer.whenReady.then(() => {
      if (!this.isDestroyed) adopt();
    });
  }

  private applySource(): void {
    const { info } = this;
    if (info === null) return;
    const start = startCameraOf(info);
    const fixed: CameraSource = { update: () => false, camera: (w, h) => fitCamera(start, w, h) };
    this.frames.setSource(this.source ?? fixed);
  }
}
