// SPDX-License-Identifier: Apache-2.0
import { createWorker } from "../resources";
import type { SegmentSink } from "../types";
import type { QualitySettings } from "./adaptation";
import { browserHost } from "./host";
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

/** Plays a scene with a renderer that the application draws with, such as a SplatRenderer. */
export class SegmentPlayer extends ScenePlayer {
  private announcement: number | null = null;
  private drawnTicks: number | null = null; // of the last frame

  /**
   * The player takes ownership of `renderer`. `onChange` is called when the image may have changed, so that
   * an application can draw on demand.
   */
  constructor(
    renderer: SegmentSink, options: SegmentPlayerOptions = {},
    private readonly onChange: () => void = () => undefined,
  ) {
    const announce = () => this.announce();
    super({ worker: createWorker, ...options }, {
      sink: renderer, host: browserHost(), onContent: announce,
      onOpened: () => {
        this.adaptation.limitRenderer(renderer.maxPrimitives ?? Infinity);
        announce();
      },
      onTime: () => {
        if (this.playback.frameTime()?.ticks !== this.drawnTicks) announce();
      },
    });
    this.loop = options.loop ?? false;
    if (options.src === undefined) return;
    this.load(options.src).catch(() => undefined); // the error event reports it
    if (options.autoplay) this.play().catch(() => undefined);
  }

  /** Call once per frame. Returns the time to draw, in ticks of the timeline; null if there is no image yet. */
  frameTicks(): number | null {
    this.playback.updateTime(false);
    const time = this.playback.frameTime();
    if (time === null || this.isDestroyed) return null;
    this.drawnTicks = time.ticks;
    if (time.running) this.announce();
    return time.ticks;
  }

  override destroy(): void {
    if (this.announcement !== null) cancelAnimationFrame(this.announcement);
    super.destroy();
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
