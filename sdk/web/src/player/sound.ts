// SPDX-License-Identifier: Apache-2.0
// The volume of a player, and the sound of its scene.
import { loadAudio } from "../audio_loader";
import type { AudioTrack, Timebase } from "../stgs-audio";
import type { SceneInfo } from "../types";
import { textOf } from "./errors";
import { EventQueue } from "./event_queue";
import { Host } from "./host";

/** Events after which the sound starts, stops, seeks or changes its rate. */
const EVENTS = ["playing", "waiting", "pause", "ended", "seeking", "seeked", "ratechange", "error"];

/** Returns a volume. Throws an IndexSizeError unless it is from 0 to 1. */
export function checkVolume(volume: number): number {
  if (!(volume >= 0 && volume <= 1))
    throw new DOMException(`volume ${volume} is out of range (expected 0 to 1)`, "IndexSizeError");
  return volume;
}

/** The sound of one player. */
export class Sound {
  private level = 1;
  private isMuted = false;
  private track: AudioTrack | null = null;
  private hasTrack = false; // there is a sound that can be played
  private current = new AbortController();
  private info: SceneInfo | null = null;

  /** `choice`: "auto" (the location in the file), "none", or a URL. */
  constructor(
    player: EventTarget, private choice: string, private readonly events: EventQueue, private readonly host: Host,
    private readonly timebase: Timebase,
  ) {
    for (const name of EVENTS) player.addEventListener(name, () => this.track?.update());
  }

  /** Whether the scene has a sound that can be played. */
  get isAvailable(): boolean {
    return this.hasTrack;
  }

  get volume(): number {
    return this.level;
  }
  set volume(volume: number) {
    if (checkVolume(volume) !== this.level) this.adopt(volume, this.isMuted);
  }

  get muted(): boolean {
    return this.isMuted;
  }
  set muted(muted: boolean) {
    if (muted !== this.isMuted) this.adopt(this.level, muted);
  }

  get source(): string {
    return this.choice;
  }
  set source(choice: string) {
    if (choice === this.choice) return;
    this.choice = choice;
    if (this.info !== null) this.open(this.info);
  }

  /** Opens the sound of a scene. */
  open(info: SceneInfo): void {
    this.close();
    this.info = info;
    const { choice } = this;
    if (choice === "none" || (choice === "auto" && info.audio === null)) return;
    const { signal } = this.current;
    this.load(info, choice, signal).catch((error: unknown) => {
      if (!signal.aborted) this.fail(textOf(error));
    });
  }

  close(): void {
    this.current.abort();
    this.current = new AbortController();
    this.info = null;
    this.track = null;
    this.setAvailable(false);
  }

  private async load(info: SceneInfo, choice: string, signal: AbortSignal): Promise<void> {
    const { openSound } = await loadAudio();
    if (signal.aborted) return; // an abort before openSound() would not end the sound
    const chosen = choice === "auto" ? null : choice;
    const track = await openSound({ scene: info.audio, chosen }, this.timebase, this.host, {
      ready: () => this.setAvailable(true),
      blocked: () => {
        this.isMuted = true;
        this.events.push("volumechange");
        this.events.push("notice", { kind: "audio", message: "muted: the browser plays sound only after a click or a key press" });
      },
      failed: (message) => this.fail(message),
    }, signal);
    if (signal.aborted) return;
    this.track = track;
    track.setVolume(this.level, this.isMuted);
    track.update();
  }

  private adopt(volume: number, muted: boolean): void {
    this.level = volume;
    this.isMuted = muted;
    this.track?.setVolume(volume, muted);
    this.events.push("volumechange");
  }

  private setAvailable(available: boolean): void {
    if (available === this.hasTrack) return;
    this.hasTrack = available;
    this.events.push("audiochange");
  }

  private fail(message: string): void {
    this.track = null;
    this.setAvailable(false);
    this.events.push("notice", { kind: "audio", message });
  }
}
