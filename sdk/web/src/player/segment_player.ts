// SPDX-License-Identifier: Apache-2.0
import { createWorker } from "../resources";
import type { SegmentSink } from "../types";
import type { QualitySettings } from "./adaptation";
import { browserHost, Host } from "./host";
import { ScenePlayer } from "./scene_player";

/** Settings of a `SegmentPlayer`. */
export interface SegmentPlayerOptions extends QualitySettings {
  /** URL of the scene, or a file. The player loads it at once. */
  src?: string | Blob;
  /** Plays as soon as data is available. */
  autoplay?: boolean;
  /** Repeats the clip. */
  loop?: boolean;
  /** Seconds to fetch ahead; default 10. */
  lookAhead?: number;
  /** See `ScenePlayer.latency`; default 1. */
  latency?: number;
  /** See `ScenePlayerOptions.audio`. */
  audio?: string;
}

/**
 * Plays a scene with a renderer that the application draws with, such as a SplatRenderer. With the quality
 * "auto", it shows fewer tiers while the frames of the application are late; the resolution is not changed.
 */
export class SegmentPlayer extends ScenePlayer {
  private announcement: number | null = null;
  private drawnTicks: number | null = null; // of the last frame
  private readonly host: Host;
  private frames = 0; // drawn while the time advanced
  private isCounted = false; // the current frame

  /**
   * The player takes ownership of `renderer`. `onChange` is called when the image may have changed, so that
   * an application can draw on demand.
   */
  constructor(
    private readonly renderer: SegmentSink, options: SegmentPlayerOptions = {},
    private readonly onChange: () => void = () => undefined,
  ) {
    const announce = () => this.announce();
    const host = browserHost();
    super({ worker: createWorker, ...options }, {
      sink: renderer, host, isDrawnByApplication: true, onContent: announce,
      onOpened: () => {
        this.adaptation.limitRenderer(renderer.maxPrimitives ?? Infinity);
        announce();
      },
      onTime: () => {
        if (this.playback.frameTime()?.ticks !== this.drawnTicks) announce();
      },
    });
    this.host = host;
    this.loop = options.loop ?? false;
    if (options.src === undefined) return;
    this.load(options.src).catch(() => undefined); // the error event reports it
    if (options.autoplay) this.play().catch(() => undefined);
  }

  /** Call for each frame. Returns the time to draw, in ticks of the timeline; null if there is no image yet. */
  frameTicks(): number | null {
    this.playback.updateTime(false);
    const time = this.playback.frameTime();
    if (time === null || this.isDestroyed) return null;
    this.drawnTicks = time.ticks;
    if (time.running) this.announce();
    if (time.running) this.countFrame();
    else this.adaptation.pause();
    return time.ticks;
  }

  override destroy(): void {
    if (this.announcement !== null) cancelAnimationFrame(this.announcement);
    super.destroy();
  }

  /** Counts a frame. The views of a frame are drawn in one task, and count once. */
  private countFrame(): void {
    if (this.isCounted) return;
    this.isCounted = true;
    queueMicrotask(() => (this.isCounted = false));
    ++this.frames;
    this.adaptation.frame(this.host.now(), this.renderer.statistics.frames ?? this.frames);
  }

  /** Calls onChange() before the next frame of the page, never during a frame. */
  protected announce(): void {
    if (this.isDestroyed) return;
    this.announcement ??= requestAnimationFrame(() => {
      this.announcement = null;
      this.onChange();
    });
  }
}
