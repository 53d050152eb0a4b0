// SPDX-License-Identifier: Apache-2.0
// Everything above the image except the control bar.
import { PlayerStats } from "../player/player";
import { create, iconButton, setIcon, setLabel } from "./dom";
import { icon } from "./icons";
import { Media } from "./media";
import { formatBytes, formatCount, formatRenderer } from "./text";

const STATISTICS_INTERVAL = 500; // milliseconds

/** Figures of the player, in a corner. */
export class StatisticsPanel {
  readonly root = create("dl", { class: "figures", "aria-label": "Statistics" });
  private timer: number | null = null;

  constructor(private readonly media: Media) {
    this.root.hidden = true;
  }

  get visible(): boolean {
    return !this.root.hidden;
  }

  show(visible: boolean): void {
    this.root.hidden = !visible;
    if (this.timer !== null) window.clearInterval(this.timer);
    this.timer = visible ? window.setInterval(() => this.update(), STATISTICS_INTERVAL) : null;
    if (visible) this.update();
  }

  private update(): void {
    const { media } = this;
    const { stats } = media;
    const rows: [string, string][] = [
      ["Frame rate", `${stats.framesPerSecond} fps`],
      ["Resolution", `${media.videoWidth} × ${media.videoHeight}`],
      ["Primitives", formatCount(stats.primitives)],
      ["Visible", formatCount(stats.visible)],
      ["Renderer", formatRenderer(media.activeRenderer, stats)],
      ["Sorting", `${stats.sortMs.toFixed(1)} ms`],
      ...gpuTimes(stats),
      ["Layers", `${stats.layers} of ${stats.layerCount}`],
      ["Buffered", `${bufferedAhead(media).toFixed(1)} s ahead`],
      ["Fetched", formatBytes(stats.bytesFetched)],
      ["Throughput", stats.bytesPerSecond > 0 ? `${formatBytes(stats.bytesPerSecond)}/s` : "–"],
      ...qualityRows(stats),
    ];
    const cells = rows.flatMap(([name, value]) => {
      return [create("dt", {}, name), create("dd", {}, value)];
    });
    this.root.replaceChildren(...cells);
  }
}

/** The rows of the times that a WebGPU renderer measures. */
function gpuTimes({ computeMs, rasterMs }: PlayerStats): [string, string][] {
  if (computeMs === undefined || rasterMs === undefined) return [];
  return [["Compute", `${computeMs.toFixed(1)} ms`], ["Rasterising", `${rasterMs.toFixed(1)} ms`]];
}

/** The rows about the quality. */
function qualityRows({ quality, memoryBytes }: PlayerStats): [string, string][] {
  if (quality === null) return [];
  const { tiers, tierCount, resolutionScale, memoryBudget } = quality;
  return [
    ["Memory", `${formatBytes(memoryBytes)} of ${formatBytes(memoryBudget)}`],
    ["Quality", `${quality.quality}, ${quality.device}`],
    ["Tiers", `${tiers} of ${tierCount}`],
    ["Scale", `${Math.round(100 * resolutionScale)} %`],
    ["Reason", quality.reason],
  ];
}

/** Seconds that are buffered after the current time. */
function bufferedAhead({ buffered, currentTime }: Media): number {
  for (let i = 0; i < buffered.length; ++i) {
    const isInside = buffered.start(i) <= currentTime && currentTime <= buffered.end(i);
    if (isInside) return buffered.end(i) - currentTime;
  }
  return 0;
}

/** The message of an error, with a button to load the source again. */
export class ErrorOverlay {
  readonly root: HTMLElement;
  private readonly message = create("p");

  constructor(retry: () => void) {
    const button = create("button", { type: "button", class: "retry" }, "Try again");
    button.addEventListener("click", retry);
    const title = create("h2", {}, "This video cannot be played");
    this.root = create("div", { class: "error", role: "alert" }, icon("alert"), title, this.message,
                       button);
    this.root.hidden = true;
  }

  show(error: { message: string } | null): void {
    this.root.hidden = error === null;
    this.message.textContent = error?.message ?? "";
  }
}

/** The image before the first frame, the large button to start, and the sign of waiting. */
export class StartOverlay {
  readonly poster = create("img", { class: "poster", alt: "", draggable: "false" });
  readonly button = iconButton("play", "Play", "start");
  readonly spinner = create("div", { class: "spinner", role: "status" },
                            create("span", { class: "hidden-text" }, "Loading"));

  constructor() {
    this.poster.hidden = true;
    this.button.hidden = true;
    this.spinner.hidden = true;
    this.poster.addEventListener("error", () => (this.poster.hidden = true));
  }

  setPoster(url: string): void {
    this.poster.hidden = url === "";
    if (url !== "") this.poster.src = url;
    else this.poster.removeAttribute("src");
  }

  setEnded(ended: boolean): void {
    setIcon(this.button, ended ? "replay" : "play");
    setLabel(this.button, ended ? "Replay" : "Play");
  }
}
