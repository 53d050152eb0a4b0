// SPDX-License-Identifier: Apache-2.0
// The interface of a media element over a worker that decodes, without the drawing of frames.
import { LiveState, SceneInfo, SegmentSink } from "../types";
import { Adaptation, Quality, QualityReport, QualitySettings } from "./adaptation";
import { abortError, PlayerError, unsupported } from "./errors";
import { EventQueue } from "./event_queue";
import { Host } from "./host";
import { checkLatency, DEFAULT_LATENCY } from "./latency";
import { Playback } from "./playback";
import { Ready } from "./playback_context";
import { BufferedRanges } from "./ranges";
import { Sound } from "./sound";
import { WorkerSource } from "./worker_link";

const MIN_RATE = -2, MAX_RATE = 4; // of the core
const LOOK_AHEAD = 10; // seconds

/** Returns a playback rate. Throws a `NotSupportedError` if it is not supported. */
export function checkRate(rate: number): number {
  if (rate >= MIN_RATE && rate <= MAX_RATE && rate !== 0) return rate;
  throw unsupported(`playbackRate ${rate} is out of range (expected ${MIN_RATE} to ${MAX_RATE}, not 0)`);
}

export interface ScenePlayerOptions extends QualitySettings {
  /**
   * Belongs to the player, which terminates it. With a function, each load gets a worker of its
   * own, so that no message of an earlier source can be taken for one of the next.
   */
  worker: WorkerSource;
  /** Seconds to fetch ahead; default 10. */
  lookAhead?: number;
  /** See `ScenePlayer.latency`; default 1. */
  latency?: number;
  /** The sound: "auto" (default): the audio file that the scene names, if it is on the same server; "none"; or a URL. */
  audio?: string;
}

/** Parts of a player, and the reports of playback to its owner. */
export interface ScenePlayerParts {
  /** Belongs to the player, which destroys it. */
  sink: SegmentSink;
  host: Host;
  /** The application draws, and sets the resolution. */
  isDrawnByApplication?: boolean;
  onOpened(): void;
  /** The time may have changed. */
  onTime(): void;
  /** The image at the current time has changed. */
  onContent(): void;
  /** The quality has changed. */
  onQuality?(): void;
}

/**
 * Plays one source at a time, with the properties and events of `HTMLMediaElement`; times are in
 * seconds. Events are dispatched after the call that causes them. `timeupdate` is dispatched at
 * most four times per second during playback, and once after each seek, pause and end. A `notice`,
 * whose `detail` is a `PlayerNotice`, reports a problem that does not end playback. `qualitychange`, whose
 * `detail` is a `QualityReport`, reports changes of the quality.
 */
export class ScenePlayer extends EventTarget {
  static readonly HAVE_NOTHING = Ready.Nothing;
  /** The duration, the bounds and the start camera are known. */
  static readonly HAVE_METADATA = Ready.Metadata;
  /** The current image is available; playback has to wait for data. */
  static readonly HAVE_CURRENT_DATA = Ready.CurrentData;
  /** Playback can continue. */
  static readonly HAVE_ENOUGH_DATA = Ready.EnoughData;

  protected readonly events = new EventQueue(this);
  protected readonly playback: Playback;
  protected readonly adaptation: Adaptation;
  private readonly sound: Sound;
  protected isDestroyed = false;
  private readonly sink: SegmentSink;
  private liveLatency: number; // seconds

  protected constructor(options: ScenePlayerOptions, parts: ScenePlayerParts) {
    super();
    this.sink = parts.sink;
    this.liveLatency = checkLatency(options.latency ?? DEFAULT_LATENCY);
    this.adaptation = new Adaptation(options, {
      limit: (primitives) => this.playback.post({ type: "maxPrimitives", primitives }),
      changed: () => {
        this.events.push("qualitychange", this.qualityReport);
        parts.onQuality?.();
      },
    }, parts.isDrawnByApplication);
    this.playback = new Playback({
      worker: options.worker,
      renderer: parts.sink,
      host: parts.host,
      events: this.events,
      options: () => ({
        memoryBudget: this.adaptation.memoryBudget, maxPrimitives: this.adaptation.maxPrimitives,
        lookAhead: options.lookAhead ?? LOOK_AHEAD, latency: this.liveLatency,
      }),
      onOpened: (info) => {
        this.adaptation.open(info);
        this.sendLatency(); // it may have changed since load()
        this.sound.open(info);
        parts.onOpened();
      },
      onTiers: (peaks) => this.adaptation.setPeaks(peaks),
      onTime: () => parts.onTime(),
      onContent: () => parts.onContent(),
    });
    this.sound = new Sound(this, options.audio ?? "auto", this.events, parts.host, {
      time: () => {
        const time = this.playback.frameTime();
        return time && { seconds: time.ticks * this.info!.tickSeconds, running: time.running };
      },
      rate: () => this.playback.rate,
    });
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
    this.adaptation.close();
    this.sound.close();
    return this.playback.load(source, signal);
  }

  /** Ends the source; the player is as new, except for its rate, its loop and its camera. */
  unload(): void {
    if (this.isDestroyed) return;
    this.adaptation.close();
    this.sound.close();
    this.playback.unload(abortError("the source was removed"));
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
    checkRate(rate);
    if (!this.isDestroyed) this.playback.setRate(rate);
  }

  /**
   * Whether the sound is muted. The player mutes itself, with `volumechange` and a `notice`, if the browser
   * requires a user gesture before it plays sound.
   */
  get muted(): boolean {
    return this.sound.muted;
  }
  set muted(muted: boolean) {
    if (!this.isDestroyed) this.sound.muted = muted;
  }
  /** 0 to 1; other values throw an `IndexSizeError`. */
  get volume(): number {
    return this.sound.volume;
  }
  set volume(volume: number) {
    if (!this.isDestroyed) this.sound.volume = volume;
  }
  /** Whether the scene has a sound that can be played; `audiochange` reports changes. */
  get hasAudio(): boolean {
    return this.sound.isAvailable;
  }
  /** See `ScenePlayerOptions.audio`. */
  get audio(): string {
    return this.sound.source;
  }
  set audio(source: string) {
    if (!this.isDestroyed) this.sound.source = source;
  }

  /** The amount of data fetched and drawn, see `Quality`. Invalid values throw a `TypeError`. */
  get quality(): Quality {
    return this.adaptation.quality;
  }
  set quality(quality: Quality) {
    if (!this.isDestroyed) this.adaptation.quality = quality;
  }
  /** The current quality for the device, and the reasons. */
  get qualityReport(): QualityReport {
    return this.adaptation.report();
  }

  get loop(): boolean {
    return this.playback.loop;
  }
  set loop(loop: boolean) {
    if (!this.isDestroyed) this.playback.setLoop(loop);
  }

  /**
   * The state of a recording in progress, whose `duration` grows; null if the file is complete.
   * Playback starts at the live edge and follows it; a pause, a seek to an earlier time, or another
   * rate ends following. The event `livechange` reports changes of `live` to and from null, and of
   * `following`.
   */
  get live(): LiveState | null {
    return this.playback.scene?.live ?? null;
  }
  /**
   * Minimum seconds behind the live edge of a recording, 0 to 3600; other values throw an `IndexSizeError`.
   * `live.targetLatency` is larger if fragments are longer or arrive irregularly; with 0, it is the least that
   * avoids stalls. While playback follows the edge, it converges to a new value by running up to 10 % faster or
   * slower, or skips ahead if it is more than 3 s behind; `goLive()` applies it at once.
   */
  get latency(): number {
    return this.liveLatency;
  }
  set latency(seconds: number) {
    if (this.isDestroyed || checkLatency(seconds) === this.liveLatency) return;
    this.liveLatency = seconds;
    this.sendLatency();
  }
  /** Seeks to the live edge and follows it at a rate of 1; a seek to the end has the same effect. */
  goLive(): void {
    if (!this.isDestroyed) this.playback.goLive();
  }

  /** Ends everything: the worker, the renderer and pending promises. No event follows. */
  destroy(): void {
    if (this.isDestroyed) return;
    this.isDestroyed = true;
    this.events.close();
    this.sound.close();
    this.playback.destroy();
    this.sink.destroy();
  }

  private sendLatency(): void {
    this.playback.post({ type: "latency", seconds: this.liveLatency });
  }
}
