// SPDX-License-Identifier: Apache-2.0
// The custom element <stgs-player>.
import { PlayerError } from "../player/errors";
import { forwardEvents } from "../player/event_queue";
import { StgsPlayer } from "../player/player";
import { resume } from "../player/resume";
import { checkRate } from "../player/scene_player";
import { checkVolume } from "../player/sound";
import type { RendererChoice } from "../renderer_choice";
import { PlayerNotice, Renderer } from "../types";
import type { XrMode, XrOptions } from "../xr/presenter";
import { BridgeAttribute } from "./bridge_attribute";
import { CameraInput } from "./camera_input";
import { createRig } from "./cameras/create_rig";
import { PadAction } from "./cameras/gamepad";
import { CameraRig, CameraView } from "./cameras/rig";
import { observePixels } from "./dom";
import type { StgsPlayerFactory } from "./factory";
import { Media, toggle } from "./media";
import { MediaState } from "./media_state";
import { Shell } from "./shell";

const MAX_PIXEL_RATIO = 2; // of the canvas to CSS pixels

/**
 * `<stgs-player src controls autoplay loop poster camera="orbit|fly" free
 * renderer="auto|webgpu|webgl2" quality="auto|low|medium|high" device="phone|headset|desktop" audio muted
 * latency bridge>`: plays a scene like a media element. Properties, methods and events are those of
 * `StgsPlayer`; attributes are reflected. Without `controls`, only the camera takes input. `free` lifts the
 * limits of the orbit.
 *
 * The player is created when the element is connected, or by `load`, `play`, `currentTime` or `srcObject`. It is
 * destroyed when the element is removed from the page; then the position is lost.
 */
export abstract class StgsPlayerElement extends MediaState implements Media {
  static readonly observedAttributes = [
    "src", "controls", "autoplay", "loop", "poster", "camera", "free", "renderer", "quality", "device",
    "audio", "bridge", "latency",
  ];

  private readonly shell: Shell;
  private readonly observer: ResizeObserver;
  private readonly bridge = new BridgeAttribute();
  private canvas: HTMLCanvasElement | null = null;
  private input: CameraInput | null = null;
  private rig: CameraRig | null = null;
  private keptRig: CameraRig | null = null; // of a source that is reloaded because the GPU was lost
  private choice: RendererChoice | null = null; // instead of `renderer`, after WebGPU was lost
  private object: Blob | null = null;
  private wantedVolume = 1;
  private wantedRate = 1; // of the next player
  private wantsMuted: boolean | null = null; // null: as the attribute states
  private isReflecting = false; // sets `src` to the source that is being loaded

  protected abstract readonly factory: StgsPlayerFactory;

  constructor() {
    super();
    this.shell = new Shell(this, this, () => this.reload());
    this.observer = new ResizeObserver(() => this.applySize());
    this.addEventListener("loadedmetadata", () => this.createCamera());
  }

  connectedCallback(): void {
    observePixels(this.observer, this);
    this.shell.connect();
    this.bridge.update(this, this.getAttribute("bridge"));
    if (this.player === null) this.reload();
  }

  disconnectedCallback(): void {
    this.observer.unobserve(this);
    this.shell.disconnect();
    this.bridge.update(this, null);
    // An element that is moved is connected again in the same task.
    queueMicrotask(() => {
      if (!this.isConnected) this.destroy();
    });
  }

  /** The element has moved to another document. */
  adoptedCallback(): void {
    this.shell.adoptStyle();
  }

  attributeChangedCallback(name: string, _old: string | null, value: string | null): void {
    switch (name) {
      case "src":
        if (this.isReflecting || (value === null && this.object !== null)) break;
        this.object = null;
        if (this.player !== null || this.isConnected) this.reload();
        break;
      case "controls":
        this.shell.setControls(value !== null);
        break;
      case "loop":
        if (this.player !== null) this.player.loop = value !== null;
        this.shell.update();
        break;
      case "poster":
        this.shell.setPoster(value ?? "");
        break;
      case "camera":
      case "free":
        this.keptRig = null;
        this.createCamera();
        break;
      case "bridge":
        if (this.isConnected) this.bridge.update(this, value);
        break;
      case "quality":
      case "audio":
      case "latency":
        if (this.player !== null) Object.assign(this.player, this.settings);
        break;
      case "renderer":
      case "device":
        this.choice = null;
        this.recreate();
    }
  }

  /** URL of the source. */
  get src(): string {
    return this.getAttribute("src") ?? "";
  }
  set src(url: string) {
    this.setAttribute("src", url);
  }
  /** A file to play instead of `src`. */
  get srcObject(): Blob | null {
    return this.object;
  }
  set srcObject(object: Blob | null) {
    this.object = object;
    this.reload();
  }
  get currentTime(): number {
    return this.player?.currentTime ?? 0;
  }
  set currentTime(seconds: number) {
    const player = this.use();
    if (player !== null) player.currentTime = seconds;
  }
  get playbackRate(): number {
    return this.player?.playbackRate ?? this.wantedRate;
  }
  set playbackRate(rate: number) {
    const isChanged = checkRate(rate) !== this.playbackRate;
    this.wantedRate = rate;
    if (this.player !== null) this.player.playbackRate = rate;
    else if (isChanged) queueMicrotask(() => this.dispatchEvent(new Event("ratechange")));
  }
  /** See `StgsPlayer.muted`; the attribute sets the initial value. */
  get muted(): boolean {
    return this.player?.muted ?? this.wantsMuted ?? this.hasAttribute("muted");
  }
  set muted(muted: boolean) {
    this.wantsMuted = muted;
    if (this.player !== null) this.player.muted = muted;
  }
  get volume(): number {
    return this.player?.volume ?? this.wantedVolume;
  }
  set volume(volume: number) {
    this.wantedVolume = checkVolume(volume);
    if (this.player !== null) this.player.volume = volume;
  }
  /** Size of the canvas, pixels. */
  get videoWidth(): number {
    return this.canvas?.width ?? 0;
  }
  get videoHeight(): number {
    return this.canvas?.height ?? 0;
  }

  play(): Promise<void> {
    return this.use()?.play() ?? Promise.reject(this.unavailable());
  }
  pause(): void {
    this.player?.pause();
  }
  goLive(): void {
    this.player?.goLive();
  }
  /** Loads `source` instead of `src` and `srcObject`; see `StgsPlayer.load`. Rejects if there is neither. */
  load(source: string | Blob = this.object ?? this.src, options: { signal?: AbortSignal } = {}): Promise<void> {
    if (source === "") return Promise.reject(new DOMException("there is no source; set src, or call load(source)", "InvalidStateError"));
    const isAborted = options.signal?.aborted ?? false; // the player only ends the previous source
    if (!isAborted) this.adoptSource(source);
    const player = this.use(false);
    if (player === null) return Promise.reject(this.unavailable());
    const loaded = player.load(source, options);
    this.dropCamera();
    if (this.autoplay && !isAborted) player.play().catch(() => undefined); // `error` or `pause` reports it
    return loaded;
  }
  screenshot(): Promise<Blob> {
    return this.player?.screenshot() ?? Promise.reject(this.unavailable());
  }

  /** Resolves to whether `enterXR` is possible in this browser and on its devices. */
  supportsXR(mode: XrMode = "immersive-vr"): Promise<boolean> {
    return this.player?.supportsXR(mode) ?? Promise.resolve(false);
  }

  /** Shows the scene in a headset; see `StgsPlayer.enterXR`. */
  enterXR(mode: XrMode = "immersive-vr", options: XrOptions = {}): Promise<void> {
    return this.player?.enterXR(mode, options) ?? Promise.reject(this.unavailable());
  }

  /** Ends the session, also a requested one; see `StgsPlayer.exitXR`. */
  exitXR(): Promise<void> {
    return this.player?.exitXR() ?? Promise.resolve();
  }

  /** The position of the camera; null before `loadedmetadata`. Assigning a view moves the camera, within its limits. */
  get cameraView(): CameraView | null {
    return this.rig?.view ?? null;
  }
  set cameraView(view: CameraView | null) {
    if (view === null || this.rig === null) return;
    this.rig.view = view;
    this.player?.requestFrame();
  }

  /** Returns to the start camera. */
  resetCamera(): void {
    this.rig?.reset();
    this.player?.requestFrame();
  }

  /**
   * Ends the player and dispatches `emptied`, and before it `leavexr` during a session; `load` or `play` creates another
   * player.
   */
  destroy(): void {
    if (this.player === null && this.failure === null) return;
    const { isInXR } = this;
    this.dropCamera();
    this.wantedRate = this.playbackRate;
    this.player?.destroy();
    this.player = null;
    this.canvas = null;
    this.failure = null;
    this.shell.setCanvas(null);
    queueMicrotask(() => { // the player dispatches no more events
      if (isInXR) this.dispatchEvent(new Event("leavexr"));
      this.dispatchEvent(new Event("emptied"));
    });
  }

  /** Ends the camera of the scene. */
  private dropCamera(): void {
    this.input?.destroy();
    this.input = null;
    this.rig = null;
    this.keptRig = null;
  }

  /** Adopts a source that is being loaded. */
  private adoptSource(source: string | Blob): void {
    this.object = source instanceof Blob ? source : null;
    if (source instanceof Blob || this.src === source) return;
    this.isReflecting = true;
    this.setAttribute("src", source);
    this.isReflecting = false;
  }

  /** Loads the source in a new player, since a canvas cannot have another renderer. */
  private recreate(): void {
    if (this.player === null) return;
    this.destroy();
    this.reload();
  }

  private reload(): void {
    if (this.object !== null || this.src !== "") this.load().catch(() => undefined);
    else {
      this.player?.unload();
      this.dropCamera();
    }
  }

  /** Returns the player; creates it if there is none, and then loads the source if `loads` is set. */
  private use(loads = true): StgsPlayer | null {
    if (this.player !== null) return this.player;
    this.failure = null;
    const canvas = document.createElement("canvas");
    let renderer: Renderer;
    try {
      renderer = this.factory.createRenderer(canvas, this.choice ?? this.renderer);
    } catch (error) {
      this.failure = new PlayerError("unsupported", (error as Error).message, false);
      queueMicrotask(() => this.dispatchEvent(new Event("error")));
      return null;
    }
    this.canvas = canvas;
    this.shell.setCanvas(canvas);
    const { device, settings } = this;
    const worker = (source: string | Blob) => this.factory.createWorker(source);
    this.player = new StgsPlayer({ canvas, renderer, worker, ...settings, ...(device && { device }) });
    this.player.volume = this.wantedVolume;
    this.player.muted = this.wantsMuted ?? this.hasAttribute("muted");
    this.player.loop = this.loop;
    // The first `ratechange` of the player reports a rate that the element has reported before.
    let isReported = this.player.playbackRate !== this.wantedRate;
    this.player.playbackRate = this.wantedRate;
    forwardEvents(this.player, this, (event) => {
      if (!isReported || event.type !== "ratechange") return this.recovers(event);
      isReported = false;
      return true;
    });
    this.applySize();
    if (loads) this.reload();
    return this.player;
  }

  /** Handles the loss of the GPU. Returns true if, after an error, a new player continues with WebGL2. */
  private recovers(event: Event): boolean {
    const { player, rig } = this;
    if (event instanceof CustomEvent && event.type === "notice" && event.detail.kind === "renderer") {
      this.keptRig = rig;
    }
    const isLost = event.type === "error" && player?.hasLostRenderer === true;
    if (player === null || !isLost || (this.choice ?? this.renderer) !== "auto") return false;
    const { currentTime, paused, live, error } = player;
    this.destroy();
    this.choice = "webgl2";
    this.keptRig = rig;
    const detail: PlayerNotice = { kind: "renderer", message: error!.message };
    this.dispatchEvent(new CustomEvent("notice", { detail }));
    const next = this.use(false);
    if (next === null) return true; // use() reports it
    resume(next, next.load(this.object ?? this.src), { currentTime, paused, live });
    return true;
  }

  private createCamera(): void {
    const { player } = this;
    if (player === null || player.info === null) return;
    const flies = this.camera === "fly";
    const rig = this.keptRig ?? createRig(player.info, flies, this.free);
    this.keptRig = null;
    this.input?.destroy();
    this.rig = rig;
    this.input = new CameraInput({
      view: this.shell.view, host: this, rig, flies,
      onMove: () => player.requestFrame(),
      onTap: (event) => this.shell.tap(event),
      onPadAction: (action) => this.onPadAction(action),
    });
    player.cameraSource = this.input;
  }

  private onPadAction(action: PadAction): void {
    if (action === "reset") return this.resetCamera();
    if (!this.controls) return;
    if (action === "toggle") toggle(this);
    else this.shell.seekBy(action === "ahead" ? 1 : -1);
  }

  private applySize(): void {
    this.shell.setSize(this.clientWidth, this.clientHeight);
    const ratio = Math.min(window.devicePixelRatio || 1, MAX_PIXEL_RATIO);
    if (this.clientWidth === 0 || this.clientHeight === 0) return;
    this.player?.resize(this.clientWidth * ratio, this.clientHeight * ratio);
  }

  private unavailable(): DOMException {
    const message = this.failure?.message ?? "there is no player; connect the element or load a source";
    return new DOMException(message, "NotSupportedError");
  }
}

declare global {
  interface HTMLElementTagNameMap {
    "stgs-player": StgsPlayerElement;
  }
}

/** Defines the element. Each definition has a factory of its own. */
export function defineStgsPlayer(factory: StgsPlayerFactory, name = "stgs-player"): void {
  customElements.define(name, class extends StgsPlayerElement {
    protected get factory(): StgsPlayerFactory {
      return factory;
    }
  });
}
