// SPDX-License-Identifier: Apache-2.0
// The shadow tree of the element, and how it follows playback.
import { StgsPlayer } from "../player/player";
import { AutoHide } from "./auto_hide";
import { ControlBar } from "./control_bar";
import { create } from "./dom";
import { KeyAction, nextRate, playbackKey, seekStep } from "./keyboard";
import { Media, toggle } from "./media";
import { ErrorOverlay, StartOverlay, StatisticsPanel } from "./overlays";
import { STYLE } from "./style";

const NARROW = 480, SHORT = 280; // CSS pixels
const VIEW_LABEL = "Scene. Drag to look around, scroll to zoom. Shift and the arrow keys rotate, " +
  "plus and minus zoom, R resets the camera.";
/** Events after which the controls show another state. */
const STATE_EVENTS = [
  "emptied", "loadstart", "loadedmetadata", "durationchange", "loadeddata", "canplay", "play",
  "playing", "pause", "waiting", "seeking", "seeked", "ratechange", "ended", "error", "progress",
  "livechange",
];

/** The canvas with its overlays and controls. */
export class Shell {
  readonly root: HTMLElement;
  /** Receives pointers; contains the canvas. */
  readonly view = create("div", {
    class: "view", tabindex: "0", role: "application", "aria-label": VIEW_LABEL, part: "view",
  });
  private readonly bar: ControlBar;
  private readonly start = new StartOverlay();
  private readonly statistics: StatisticsPanel;
  private readonly error: ErrorOverlay;
  private readonly autoHide: AutoHide;
  private controls = false;
  private hasPlayed = false; // since the source was loaded

  constructor(
    private readonly host: HTMLElement, private readonly media: Media, reload: () => void,
  ) {
    this.bar = new ControlBar(media, {
      toggleFullscreen: () => this.toggleFullscreen(),
      toggleStatistics: () => this.toggleStatistics(),
      canFullscreen: document.fullscreenEnabled,
    });
    this.statistics = new StatisticsPanel(media);
    this.error = new ErrorOverlay(reload);
    this.autoHide = new AutoHide(
      () => !this.bar.busy && this.controls,
      (hidden) => this.setIdle(hidden),
    );
    this.root = create("div", { class: "root" }, this.view, this.start.poster, this.start.spinner,
                       this.start.button, this.statistics.root, this.bar.root, this.error.root);
    host.attachShadow({ mode: "open" }).append(this.root);
    this.adoptStyle();
    this.listen();
    this.setControls(false);
  }

  /**
   * Creates the style sheet in the document of the element, since a shadow tree cannot adopt that of another document.
   * A content security policy can block <style> elements, but not constructed sheets.
   */
  adoptStyle(): void {
    const view = this.host.ownerDocument.defaultView;
    if (view === null) return; // the document is not displayed
    const sheet = new view.CSSStyleSheet();
    sheet.replaceSync(STYLE);
    this.host.shadowRoot!.adoptedStyleSheets = [sheet];
  }

  setControls(visible: boolean): void {
    this.controls = visible;
    this.bar.root.hidden = !visible;
    this.update();
  }

  setPoster(url: string): void {
    this.start.setPoster(url);
  }

  /** Lays out for this size, CSS pixels. */
  setSize(width: number, height: number): void {
    this.root.classList.toggle("narrow", width < NARROW);
    this.root.classList.toggle("short", height < SHORT);
    this.root.style.setProperty("--height", `${height}px`);
  }

  /** Replaces the canvas: a renderer that was destroyed leaves its canvas without a context. Null: there is none. */
  setCanvas(canvas: HTMLCanvasElement | null): void {
    this.view.replaceChildren(...(canvas === null ? [] : [canvas]));
  }

  /** A press on the image: a mouse plays and pauses, a finger shows and hides the controls. */
  tap(event: PointerEvent): void {
    if (!this.controls || this.media.error !== null) return;
    if (event.pointerType === "mouse") toggle(this.media);
    else this.autoHide.tap();
  }

  /** Seeks by the step of the arrow keys. */
  seekBy(direction: 1 | -1): void {
    const { media } = this;
    if (Number.isNaN(media.duration)) return;
    media.currentTime = media.currentTime + direction * seekStep(media.duration);
  }

  /** Ends timers; `connect` starts them again. */
  disconnect(): void {
    this.autoHide.stop();
    this.bar.animate(false);
    this.bar.closeMenu();
    this.statistics.show(false);
    this.bar.setStatistics(false);
    document.removeEventListener("fullscreenchange", this.onFullscreen);
  }

  connect(): void {
    document.addEventListener("fullscreenchange", this.onFullscreen);
    this.update();
  }

  private readonly onFullscreen = () => this.bar.setFullscreen(this.host.matches(":fullscreen"));

  private listen(): void {
    const { host, media, autoHide } = this;
    media.addEventListener("emptied", () => (this.hasPlayed = false));
    media.addEventListener("play", () => (this.hasPlayed = true));
    for (const name of STATE_EVENTS) media.addEventListener(name, () => this.update());
    media.addEventListener("timeupdate", () => this.bar.updateTime());
    for (const name of ["play", "pause", "emptied"]) {
      media.addEventListener(name, () => autoHide.setPlaying(!media.paused));
    }
    host.addEventListener("pointermove", (event) => {
      if (event.pointerType === "mouse") autoHide.wake();
    });
    host.addEventListener("pointerleave", (event) => {
      if (event.pointerType === "mouse") autoHide.leave();
    });
    this.bar.root.addEventListener("pointerdown", () => autoHide.wake());
    this.start.button.addEventListener("click", () => {
      toggle(media);
      this.view.focus({ preventScroll: true });
    });
    host.addEventListener("keydown", (event) => this.onKey(event));
  }

  /** Shows the state of the media. */
  update(): void {
    const { media, start } = this;
    const isLoading = media.hasSource && media.readyState < StgsPlayer.HAVE_CURRENT_DATA;
    const isWaiting = media.hasSource && !media.paused &&
      media.readyState < StgsPlayer.HAVE_ENOUGH_DATA;
    const invites = this.controls && media.hasSource && media.paused;
    this.root.classList.toggle("has-frame", media.readyState >= StgsPlayer.HAVE_CURRENT_DATA);
    this.root.classList.toggle("failed", media.error !== null);
    start.button.hidden = !invites || (this.hasPlayed && !media.ended) || isLoading;
    start.setEnded(media.ended);
    start.spinner.hidden = !isLoading && !isWaiting;
    this.error.show(media.error);
    this.bar.update();
    this.animate();
  }

  private animate(): void {
    const { media } = this;
    const advances = !media.paused && media.readyState >= StgsPlayer.HAVE_ENOUGH_DATA;
    this.bar.animate(this.controls && advances && !this.autoHide.hidden && this.host.isConnected);
  }

  private setIdle(idle: boolean): void {
    this.root.classList.toggle("idle", idle);
    this.host.toggleAttribute("idle", idle);
    this.animate();
  }

  private onKey(event: KeyboardEvent): void {
    if (!this.controls || event.defaultPrevented || this.media.error !== null) return;
    const action = playbackKey(event);
    const target = event.composedPath()[0];
    // Space and Enter press the focused button.
    const pressesButton = target instanceof HTMLButtonElement && event.key === " ";
    if (action === null || pressesButton) return this.autoHide.wake();
    event.preventDefault();
    this.act(action);
    this.autoHide.wake();
  }

  private act(action: KeyAction): void {
    const { media } = this;
    switch (action.type) {
      case "toggle":
        return toggle(media);
      case "seekBy":
        return this.seekBy(action.direction);
      case "stepBy":
        return this.step(action.direction);
      case "seekToStart":
        media.currentTime = 0;
        return;
      case "seekToEnd":
        if (!Number.isNaN(media.duration)) media.currentTime = media.duration;
        return;
      case "rateBy":
        media.playbackRate = nextRate(media.playbackRate, action.direction);
        return;
      case "loop":
        media.loop = !media.loop;
        return this.bar.update();
      case "mute":
        if (media.hasAudio) media.muted = !media.muted;
        return;
      case "fullscreen":
        return this.toggleFullscreen();
      case "statistics":
        return this.toggleStatistics();
    }
  }

  /** Pauses and moves by one frame. */
  private step(direction: 1 | -1): void {
    const { media } = this;
    if (media.info === null) return;
    media.pause();
    media.currentTime = media.currentTime + direction * media.info.tickSeconds;
  }

  private toggleFullscreen(): void {
    if (!document.fullscreenEnabled) return;
    const done = this.host.matches(":fullscreen") ? document.exitFullscreen()
                                                  : this.host.requestFullscreen();
    done.catch(() => undefined); // the page does not permit it, and nothing changes
  }

  private toggleStatistics(): void {
    const visible = !this.statistics.visible;
    this.statistics.show(visible);
    this.bar.setStatistics(visible);
  }
}
