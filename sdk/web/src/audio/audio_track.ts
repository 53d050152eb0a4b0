// SPDX-License-Identifier: Apache-2.0
// Sound that follows the time of a scene.
import type { Host } from "../player/host";

/** The part of HTMLAudioElement that is used. */
export interface SoundElement {
  currentTime: number;
  playbackRate: number;
  volume: number;
  muted: boolean;
  readonly duration: number;
  readonly paused: boolean;
  readonly seeking: boolean;
  readonly readyState: number;
  readonly error: { message: string } | null;
  play(): Promise<void>;
  pause(): void;
  addEventListener(type: string, listener: () => void): void;
}

/** The playback that the sound follows. */
export interface Timebase {
  /** The time of the image, in seconds, and whether it advances; null if there is no image yet. */
  time(): { seconds: number; running: boolean } | null;
  /** Seconds per second; negative: backwards. */
  rate(): number;
}

/** Receives the events of the sound. */
export interface TrackOwner {
  /** The sound can be played. */
  ready(): void;
  /** The browser requires a user gesture before it plays sound; the sound is now muted. */
  blocked(): void;
  /** It cannot be played. */
  failed(message: string): void;
}

const INTERVAL = 200; // milliseconds between two checks
const TOLERANCE = 0.02; // seconds; a smaller drift is not corrected
const MAX_DRIFT = 0.25; // seconds; a larger drift is corrected by a seek instead of the rate
const MAX_CORRECTION = 0.06; // of the rate
const CORRECTION_TIME = 2; // seconds to correct a drift, unless MAX_CORRECTION limits the rate
const MAX_LEAD = 1; // seconds
const MIN_RATE = 0.25, MAX_RATE = 4; // range in which browsers play sound
const HAVE_METADATA = 1, HAVE_FUTURE_DATA = 3;

/**
 * Plays a sound that begins at `begin`, seconds of the scene, while the scene advances. A drift of
 * more than 0.02 s is corrected by changing the rate by up to 6 %, a drift of more than 0.25 s by a
 * seek. There is no sound in backward playback, at rates that browsers do not play, and outside the
 * duration of the sound.
 */
export class AudioTrack {
  private timer: number | null = null;
  private lead = 0; // seconds; the duration of a seek
  private hasSought = false; // since the last check
  private isOver = false;

  constructor(
    private readonly element: SoundElement, private readonly begin: number,
    private readonly timebase: Timebase, private readonly host: Host, private readonly owner: TrackOwner,
  ) {
    element.addEventListener("loadedmetadata", () => {
      if (this.isOver) return;
      this.owner.ready();
      this.update();
    });
    for (const name of ["canplay", "seeked"]) element.addEventListener(name, () => this.update());
    element.addEventListener("error", () => {
      if (!this.isOver) this.fail(element.error?.message || "this browser does not support its format");
    });
  }

  setVolume(volume: number, muted: boolean): void {
    this.element.volume = volume;
    this.element.muted = muted;
  }

  /** Synchronises with the scene. Call it when playback starts, stops, seeks or changes its rate. */
  update(): void {
    if (this.timer !== null) this.host.clearTimer(this.timer);
    this.timer = null;
    if (this.isOver || this.element.readyState < HAVE_METADATA) return;
    const { seconds, running } = this.timebase.time() ?? { seconds: 0, running: false };
    const rate = this.timebase.rate();
    if (!running) return this.stop();
    const target = seconds - this.begin;
    if (rate < MIN_RATE || rate > MAX_RATE || target < 0 || target >= this.element.duration - TOLERANCE) this.stop();
    else if (this.element.paused) this.start(target, rate);
    else this.correct(target, rate);
    // The scene may reach the beginning of the sound before the next check.
    const wait = target < 0 && rate > 0 ? (-1000 * target) / rate : Infinity;
    this.timer = this.host.setTimer(() => this.update(), Math.min(INTERVAL, wait));
  }

  /** Stops the sound. The owner is not called afterwards. */
  destroy(): void {
    this.isOver = true;
    if (this.timer !== null) this.host.clearTimer(this.timer);
    this.timer = null;
    this.stop();
  }

  private stop(): void {
    if (!this.element.paused) this.element.pause();
  }

  private start(target: number, rate: number): void {
    this.element.playbackRate = rate;
    if (Math.abs(this.element.currentTime - target) > TOLERANCE) this.seek(target);
    this.play();
  }

  private play(): void {
    this.element.play().catch((error: unknown) => {
      const { name, message } = error as Error;
      if (this.isOver || name === "AbortError") return; // paused in the meantime
      if (name !== "NotAllowedError") return this.fail(message);
      if (this.element.muted) return; // the next update tries again
      this.element.muted = true;
      this.owner.blocked();
      if (this.timebase.time()?.running === true) this.play();
    });
  }

  private correct(target: number, rate: number): void {
    const { element } = this;
    if (element.seeking || element.readyState < HAVE_FUTURE_DATA) return; // checked once it continues
    const drift = element.currentTime - target;
    if (this.hasSought) this.lead = Math.min(Math.max(this.lead - drift, 0), MAX_LEAD);
    this.hasSought = false;
    if (Math.abs(drift) > MAX_DRIFT) this.seek(target + rate * this.lead);
    const isSmall = Math.abs(drift) <= TOLERANCE || Math.abs(drift) > MAX_DRIFT;
    const share = isSmall ? 0 : drift / CORRECTION_TIME;
    element.playbackRate = rate * (1 - Math.min(Math.max(share, -MAX_CORRECTION), MAX_CORRECTION));
  }

  private seek(target: number): void {
    this.element.currentTime = Math.min(target, this.element.duration);
    this.hasSought = true;
  }

  private fail(why: string): void {
    this.destroy();
    this.owner.failed(`the sound cannot be played: ${why}`);
  }
}
