// SPDX-License-Identifier: Apache-2.0
import { create } from "./dom";
import { sliderTime } from "./keyboard";
import { Media } from "./media";
import { formatTime, speakTime } from "./text";

/** The time line: the buffered ranges, the played part, and a handle to drag. */
export class SeekSlider {
  readonly root: HTMLElement;
  private readonly buffered = create("div", { class: "buffered" });
  private readonly played = create("div", { class: "played" });
  private readonly thumb = create("div", { class: "thumb" });
  private readonly hint = create("div", { class: "hint", "aria-hidden": "true" });
  private scrubbing: number | null = null; // pointer

  constructor(private readonly media: Media) {
    const track = create("div", { class: "track" }, this.buffered, this.played);
    this.root = create("div", {
      class: "seek", role: "slider", tabindex: "0", "aria-label": "Time", "aria-valuemin": "0",
      "aria-orientation": "horizontal",
    }, track, this.thumb, this.hint);
    this.root.addEventListener("pointerdown", (event) => this.begin(event));
    this.root.addEventListener("pointermove", (event) => this.move(event));
    this.root.addEventListener("keydown", (event) => this.onKey(event));
    this.root.addEventListener("pointerleave", () => this.root.classList.remove("hover"));
    for (const type of ["pointerup", "pointercancel"] as const) {
      this.root.addEventListener(type, (event) => this.end(event));
    }
  }

  /** Whether the handle is being dragged. */
  get active(): boolean {
    return this.scrubbing !== null;
  }

  /** Shows the current time. */
  update(): void {
    const duration = this.duration();
    const time = this.media.currentTime;
    const share = duration > 0 ? Math.min(time / duration, 1) : 0;
    this.played.style.transform = `scaleX(${share})`;
    this.thumb.style.left = `${100 * share}%`;
    const spoken = `${speakTime(time)} of ${speakTime(duration)}`;
    if (spoken === this.root.getAttribute("aria-valuetext")) return;
    this.root.setAttribute("aria-valuetext", spoken);
    this.root.setAttribute("aria-valuenow", time.toFixed(2));
    this.root.setAttribute("aria-valuemax", duration.toFixed(2));
    this.root.setAttribute("aria-disabled", String(duration === 0));
  }

  /** Shows the buffered ranges. */
  updateBuffered(): void {
    const { buffered } = this.media;
    const duration = this.duration();
    const ranges: HTMLElement[] = [];
    for (let i = 0; i < buffered.length && duration > 0; ++i) {
      const begin = buffered.start(i) / duration, end = Math.min(buffered.end(i) / duration, 1);
      const range = create("div");
      range.style.left = `${100 * begin}%`;
      range.style.width = `${100 * Math.max(end - begin, 0)}%`;
      ranges.push(range);
    }
    this.buffered.replaceChildren(...ranges);
  }

  private duration(): number {
    const { duration } = this.media;
    return Number.isFinite(duration) ? duration : 0;
  }

  private timeAt(event: PointerEvent): number {
    const { left, width } = this.root.getBoundingClientRect();
    const share = Math.min(Math.max((event.clientX - left) / Math.max(width, 1), 0), 1);
    return share * this.duration();
  }

  private begin(event: PointerEvent): void {
    if (event.button !== 0 || this.duration() === 0) return;
    this.scrubbing = event.pointerId;
    this.root.setPointerCapture(event.pointerId);
    this.root.classList.add("scrubbing");
    this.seek(event);
  }

  private move(event: PointerEvent): void {
    const duration = this.duration();
    if (duration === 0) return;
    const time = this.timeAt(event);
    this.root.classList.add("hover");
    this.hint.textContent = formatTime(time, duration);
    const { width } = this.root.getBoundingClientRect();
    const half = this.hint.offsetWidth / 2;
    const x = Math.min(Math.max((time / duration) * width, half), width - half);
    this.hint.style.left = `${x}px`;
    if (event.pointerId === this.scrubbing) this.seek(event);
  }

  private end(event: PointerEvent): void {
    if (event.pointerId !== this.scrubbing) return;
    this.scrubbing = null;
    this.root.classList.remove("scrubbing");
    if (event.pointerType !== "mouse") this.root.classList.remove("hover");
  }

  /** The keys of a slider do not reach the player, where up and down change the speed. */
  private onKey(event: KeyboardEvent): void {
    const duration = this.duration();
    const time = duration === 0 ? null : sliderTime(event, this.media.currentTime, duration);
    if (time === null) return;
    event.preventDefault();
    this.seekTo(time);
  }

  private seek(event: PointerEvent): void {
    this.seekTo(this.timeAt(event));
  }

  private seekTo(time: number): void {
    this.media.currentTime = time;
    this.update();
  }
}
