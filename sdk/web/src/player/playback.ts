// SPDX-License-Identifier: Apache-2.0
// The state machine of playback: the requests of the caller, and the reports of the core.
import { CoreMessage, PackedSegment, PageMessage, SceneInfo } from "../types";
import { PlaybackClock } from "./clock";
import { abortError, ErrorReason, PlayerError, textOf, unsupported } from "./errors";
import { EventQueue } from "./event_queue";
import { PlaybackContext, Ready } from "./playback_context";
import { ReportWait } from "./report_wait";
import { SceneState } from "./scene_state";
import { CoreState, Seek } from "./seek";
import { absoluteSource, Session, Waiters } from "./session";
import { WorkerLink } from "./worker_link";

const TIMEUPDATE_INTERVAL = 250; // milliseconds
const END_TOLERANCE = 1e-6; // seconds

/** Playback of one source at a time. Times are in seconds; see `ScenePlayer` for the rules. */
export class Playback {
  ready: Ready = Ready.Nothing;
  source: string | Blob | null = null;
  error: PlayerError | null = null;
  scene: SceneState | null = null;
  paused = true;
  rate = 1;
  loop = false;

  private readonly core: WorkerLink;
  private readonly clock = new PlaybackClock();
  private readonly starting = new Waiters(); // promises of play()
  private session: Session | null = null;
  private seek: Seek | null = null;
  private startTime: number | null = null; // of a seek before the scene is open
  private latest: CoreState | null = null; // of this source
  private readonly report: ReportWait;
  private hasStarted = false; // the core has played or buffered since play()
  private lastTimeupdate = -Infinity;
  private isPlaying = false; // the core plays, and `playing` is dispatched
  private isEnded = false;

  constructor(private readonly context: PlaybackContext) {
    this.report = new ReportWait(context.host, () => {
      if (this.latest !== null) this.follow(this.latest);
    });
    this.core = new WorkerLink(
      context.worker,
      (message) => this.onMessage(message),
      (message) => this.fail("unsupported", `the worker failed: ${message}`),
    );
  }

  get ended(): boolean {
    return this.isEnded && !this.loop;
  }

  get hasSource(): boolean {
    return this.session !== null;
  }

  get seeking(): boolean {
    return this.seek !== null;
  }

  load(source: string | Blob, signal?: AbortSignal): Promise<void> {
    this.unload(abortError("another source was loaded"));
    const reason = () => signal?.reason ?? abortError("loading was aborted");
    if (signal?.aborted) return Promise.reject(reason());
    this.source = absoluteSource(source);
    this.events.push("loadstart");
    try {
      this.core.start(this.source);
    } catch (error) {
      return Promise.reject(this.fail("unsupported", `the worker did not start: ${textOf(error)}`));
    }
    const session = new Session();
    this.session = session;
    if (signal) session.listen(signal, () => this.unload(reason()));
    this.core.post({ type: "open", source: this.source, options: this.context.options() });
    return session.opened;
  }

  play(): Promise<void> {
    if (this.error !== null) return Promise.reject(unsupported(this.error.message));
    if (this.paused) {
      if (this.isAtEnd()) this.seekTo(this.rate > 0 ? 0 : this.clock.duration);
      this.paused = false;
      this.hasStarted = false;
      this.report.reset();
      this.events.push("play");
      if (this.ready < Ready.EnoughData) this.events.push("waiting");
      this.post({ type: "play" });
    }
    return this.isPlaying ? Promise.resolve() : this.starting.wait();
  }

  pause(): void {
    if (this.paused) return;
    this.clock.freeze(this.now());
    this.stopPlaying();
    this.post({ type: "pause" });
    this.context.onTime();
  }

  get currentTime(): number {
    if (this.scene === null) return this.startTime ?? 0;
    if (this.isEnded) return this.scene.duration; // after the last frame
    return this.seek?.target ?? this.shownTime();
  }

  seekTo(seconds: number): void {
    if (this.scene === null) {
      this.startTime = Math.max(0, seconds);
      return;
    }
    if (this.session === null) return;
    this.isEnded = false;
    this.report.reset();
    this.events.push("seeking");
    const target = Math.min(Math.max(seconds, 0), this.scene.duration);
    if (this.seek !== null) {
      this.seek.target = target;
      return;
    }
    this.clock.freeze(this.now());
    this.seek = new Seek(target, this.context.host, (time, id) => {
      this.core.post({ type: "seek", seconds: time, id });
    });
    this.seek.flush();
  }

  setRate(rate: number): void {
    if (rate === this.rate) return;
    this.rate = rate;
    this.clock.setRate(rate, this.now());
    this.post({ type: "rate", rate });
    this.events.push("ratechange");
  }

  setLoop(loop: boolean): void {
    if (loop === this.loop) return;
    this.loop = loop;
    this.clock.loop = loop;
    this.post({ type: "loop", loop });
  }

  /** Seeks to the live edge and follows it at a rate of 1. */
  goLive(): void {
    if (!this.scene?.live) return;
    this.setRate(1);
    this.seekTo(this.scene.duration);
  }

  /** Whether playback would end at once. */
  private isAtEnd(): boolean {
    if (this.scene === null || this.scene.live !== null || this.seek !== null) return false;
    const time = this.shownTime();
    return this.rate > 0 ? time >= this.clock.last - END_TOLERANCE : time <= END_TOLERANCE;
  }

  /** The time of the image, which stays during a seek until the data of the target is available. */
  shownTime(): number {
    return this.clock.time(this.now());
  }

  /** The time to render; null before there is an image. */
  frameTime(): { ticks: number; running: boolean } | null {
    const isAvailable = this.ready >= Ready.CurrentData && this.error === null;
    if (this.scene === null || !isAvailable) return null;
    return { ticks: this.shownTime() / this.scene.info.tickSeconds, running: this.clock.running };
  }

  /** Ends everything: the worker and pending promises. */
  destroy(): void {
    this.endSession(abortError("the player was destroyed"));
    this.paused = true;
    this.core.terminate();
  }

  /** Reports an error, which ends the source. Later errors of the source are ignored. */
  fail(reason: ErrorReason, message: string): PlayerError {
    if (this.error !== null) return this.error;
    const error = new PlayerError(reason, message, this.scene !== null);
    this.clock.freeze(this.now());
    this.endSession(error, unsupported(message));
    this.core.close();
    this.error = error;
    this.events.push("error");
    return error;
  }

  /** Dispatches `timeupdate`: if it is due, or after a seek, a pause or the end. */
  updateTime(force: boolean): void {
    const now = this.now();
    if (!force && (!this.clock.running || now - this.lastTimeupdate < TIMEUPDATE_INTERVAL)) return;
    this.lastTimeupdate = now;
    this.events.push("timeupdate");
  }

  private get events(): EventQueue {
    return this.context.events;
  }

  private now(): number {
    return this.context.host.now();
  }

  /** Sends a message to the core, which takes it once the scene is open; `onOpened` sends the state until then. */
  post(message: PageMessage): void {
    if (this.scene !== null) this.core.post(message);
  }

  /** Ends the source; the player is as new, except for its rate, its loop and its camera. */
  unload(reason: unknown): void {
    const wasUsed = this.session !== null || this.scene !== null || this.error !== null;
    if (this.session !== null && this.scene === null) this.events.push("abort");
    this.endSession(reason);
    this.core.close();
    this.scene?.clear();
    this.scene = null;
    this.source = null;
    this.error = null;
    this.startTime = null;
    this.latest = null;
    this.ready = Ready.Nothing;
    this.paused = true;
    this.isEnded = false;
    this.clock.jump(0, 0, this.rate, false);
    if (wasUsed) this.events.push("emptied");
  }

  /** Rejects the promises that wait for the source. */
  private endSession(reason: unknown, playReason = reason): void {
    this.seek?.cancel();
    this.seek = null;
    this.report.reset();
    this.session?.end(reason);
    this.session = null;
    this.isPlaying = false;
    this.starting.reject(playReason);
  }

  private onMessage(message: CoreMessage): void {
    switch (message.type) {
      case "opened":
        return this.onOpened(message.info);
      case "state":
        return this.onState(message);
      case "segment":
        this.addSegment(message.segment);
        return this.report.extend();
      case "dropped":
        if (this.scene?.remove(message.id, this.shownTime())) this.context.onContent();
        return;
      case "problem":
        return this.events.push("notice", { kind: message.kind, message: message.message });
      case "error":
        this.fail(message.code, message.message);
    }
  }

  private addSegment(segment: PackedSegment): void {
    try {
      if (this.scene?.add(segment, this.shownTime())) this.context.onContent();
    } catch (error) {
      this.fail("memory", `rendering failed: ${textOf(error)}`);
    }
  }

  private onOpened(info: SceneInfo): void {
    try {
      this.scene = new SceneState(info, this.context.renderer);
    } catch (error) {
      return void this.fail("unsupported", `rendering failed: ${textOf(error)}`);
    }
    this.clock.duration = info.duration;
    this.clock.tick = info.tickSeconds;
    this.ready = Ready.Metadata;
    this.context.onOpened(info);
    this.events.push("durationchange");
    this.events.push("loadedmetadata");
    this.session?.markOpen();
    if (this.rate !== 1) this.post({ type: "rate", rate: this.rate });
    if (this.loop) this.post({ type: "loop", loop: true });
    if (this.startTime !== null) this.seekTo(this.startTime);
    this.startTime = null;
    if (!this.paused) this.post({ type: "play" });
  }

  private onState(state: CoreState): void {
    const scene = this.scene;
    if (scene === null) return;
    for (const name of scene.apply(state)) this.events.push(name);
    this.clock.duration = scene.duration;
    this.clock.loop = this.loop && scene.live === null;
    if (scene.live?.following && state.rate === this.rate) this.setRate(1); // the edge was reached
    this.clock.canWrap = scene.canWrap();
    this.context.onTiers(state.tierPrimitives);
    this.latest = state;
    this.follow(state);
    this.updateTime(false);
    this.context.onTime();
  }

  private follow(state: CoreState): void {
    if (state.state === "playing" || state.state === "buffering") this.hasStarted = true;
    // The core may have reported the end before it received play().
    const isOutdated = state.state === "ended" && !this.paused && !this.hasStarted;
    if (isOutdated && !this.report.expired) return this.report.start();
    const hasData = this.hasData(state);
    if (!this.followSeek(state, hasData)) this.followTime(state);
    if (this.seek === null) this.followPlayback(state, hasData);
  }

  /** Whether the image at the time of `state` is available. */
  private hasData(state: CoreState): boolean {
    if (this.scene === null) return false;
    if (this.scene.hasData(state)) {
      this.report.reset();
      return true;
    }
    if (state.state !== "paused") return false;
    if (this.report.expired) return this.scene.isActive(state.seconds);
    this.report.start();
    return false;
  }

  /** Takes over the time of the answer to a seek. Returns whether a seek is active. */
  private followSeek(state: CoreState, hasData: boolean): boolean {
    if (this.seek === null || this.scene === null) return false;
    if (!this.seek.isAnswer(state)) return true;
    if (!hasData) {
      this.stall();
      return true;
    }
    this.clock.jump(state.seconds, state.at, state.rate, this.advances(state));
    if (this.seek.finish()) {
      this.seek = null;
      this.updateTime(true);
      this.events.push("seeked");
    }
    return true;
  }

  private followTime(state: CoreState): void {
    const { seconds, at, rate } = state;
    if (state.state === "ended" || (this.paused && state.state === "paused")) {
      this.clock.jump(seconds, at, rate, false);
    } else if (!this.paused && state.state !== "paused") {
      this.clock.follow(seconds, at, rate, this.advances(state), this.now());
    }
  }

  private followPlayback(state: CoreState, hasData: boolean): void {
    if (hasData) this.becomeReady();
    else if (state.state === "buffering") this.stall();
    if (this.paused) return;
    if (state.state === "ended") this.finishPlayback();
    else if (state.state === "playing" && !this.isPlaying) {
      this.isPlaying = true;
      this.isEnded = false;
      this.events.push("playing");
      this.starting.resolve();
    }
  }

  private becomeReady(): void {
    if (this.ready === Ready.Metadata) {
      this.ready = Ready.CurrentData;
      this.events.push("loadeddata");
      this.context.onContent();
    }
    if (this.ready === Ready.CurrentData) {
      this.ready = Ready.EnoughData;
      this.events.push("canplay");
    }
  }

  private stall(): void {
    if (this.ready === Ready.EnoughData) this.ready = Ready.CurrentData;
    if (this.isPlaying) this.events.push("waiting");
    this.isPlaying = false;
  }

  private finishPlayback(): void {
    this.isEnded = this.rate > 0;
    this.stopPlaying();
    if (this.isEnded) this.events.push("ended");
  }

  private stopPlaying(): void {
    this.paused = true;
    this.isPlaying = false;
    this.updateTime(true);
    this.events.push("pause");
    this.starting.reject(abortError("playback was paused"));
  }

  private advances(state: CoreState): boolean {
    return state.state === "playing" && !this.paused;
  }
}
