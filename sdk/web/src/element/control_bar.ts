// SPDX-License-Identifier: Apache-2.0
import { create, iconButton, setIcon, setLabel } from "./dom";
import { Media, toggle } from "./media";
import { MuteButton } from "./mute_button";
import { SeekSlider } from "./seek_slider";
import { SpeedMenu } from "./speed_menu";
import { formatTime } from "./text";
import { XrButton } from "./xr_button";

/** Actions of buttons that do not belong to playback. */
export interface BarActions {
  toggleFullscreen(): void;
  toggleStatistics(): void;
  /** Whether the page may show elements in fullscreen. */
  readonly canFullscreen: boolean;
}

/** The bar at the bottom: the time line, and a row of buttons. */
export class ControlBar {
  readonly root: HTMLElement;
  private readonly slider: SeekSlider;
  private readonly speed: SpeedMenu;
  private readonly mute: MuteButton;
  private readonly play = iconButton("play", "Play", "button play");
  private readonly now = create("span", { class: "now" }, "0:00");
  private readonly total = create("span", { class: "total" }, "0:00");
  private readonly live = create("button", { type: "button", class: "button live" }, "Live");
  private readonly loop = iconButton("loop", "Loop", "button loop");
  private readonly statistics = iconButton("stats", "Statistics", "button statistics");
  private readonly fullscreen = iconButton("enterFullscreen", "Fullscreen", "button fullscreen");
  private frame: number | null = null;

  constructor(private readonly media: Media, actions: BarActions) {
    this.slider = new SeekSlider(media);
    this.speed = new SpeedMenu(media);
    this.mute = new MuteButton(media);
    const time = create("div", { class: "time" }, this.now, this.total);
    const space = create("div", { class: "space" });
    this.fullscreen.hidden = !actions.canFullscreen;
    const row = create("div", { class: "row" }, this.play, this.mute.root, time, this.live, space, this.speed.root, this.loop,
                       this.statistics, new XrButton(media).root, this.fullscreen);
    this.root = create("div", { class: "bar", role: "group", "aria-label": "Playback" },
                       this.slider.root, row);
    this.play.addEventListener("click", () => toggle(media));
    this.live.addEventListener("click", () => {
      media.goLive();
      media.play().catch(() => undefined); // the error event reports failures
    });
    this.loop.addEventListener("click", () => (media.loop = !media.loop));
    this.statistics.addEventListener("click", () => actions.toggleStatistics());
    this.fullscreen.addEventListener("click", () => actions.toggleFullscreen());
    this.setStatistics(false);
    this.update();
  }

  /** Whether input is in progress that the bar must stay visible for. */
  get busy(): boolean {
    const hasFocus = this.root.querySelector(":focus-visible") !== null;
    return hasFocus || this.slider.active || this.speed.isOpen;
  }

  /** Shows the state of the media. */
  update(): void {
    const { media } = this;
    setIcon(this.play, media.ended ? "replay" : media.paused ? "play" : "pause");
    setLabel(this.play, media.ended ? "Replay" : media.paused ? "Play" : "Pause");
    this.loop.setAttribute("aria-pressed", String(media.loop));
    const isLive = media.live?.following === true && !media.paused;
    this.live.hidden = media.live === null;
    this.total.hidden = media.live !== null;
    this.live.setAttribute("aria-pressed", String(isLive));
    setLabel(this.live, isLive ? "Live" : "Go to the live edge");
    this.mute.update();
    this.speed.update();
    this.slider.updateBuffered();
    this.updateTime();
  }

  updateTime(): void {
    const duration = Number.isFinite(this.media.duration) ? this.media.duration : 0;
    const time = Math.min(this.media.currentTime, duration);
    const now = formatTime(time, duration);
    if (now !== this.now.textContent) this.now.textContent = now;
    const total = formatTime(duration, duration);
    if (total !== this.total.textContent) this.total.textContent = total;
    this.slider.update();
  }

  /** Shows the time of each frame until `animate(false)`. */
  animate(enabled: boolean): void {
    if (enabled === (this.frame !== null)) return;
    if (this.frame !== null) cancelAnimationFrame(this.frame);
    this.frame = null;
    if (enabled) this.step();
  }

  /** Hides the menu. */
  closeMenu(): void {
    this.speed.hide();
  }

  setStatistics(visible: boolean): void {
    this.statistics.setAttribute("aria-pressed", String(visible));
  }

  setFullscreen(active: boolean): void {
    setIcon(this.fullscreen, active ? "exitFullscreen" : "enterFullscreen");
    setLabel(this.fullscreen, active ? "Exit fullscreen" : "Fullscreen");
  }

  private step(): void {
    this.frame = requestAnimationFrame(() => {
      this.updateTime();
      this.step();
    });
  }
}
