// SPDX-License-Identifier: Apache-2.0
// The messages of a bridge. Its two sides are the page with the player, and the page that embeds it.
//
// 1. The embedding page sends a Ping to any origin. It contains nothing private.
// 2. The page with the player sends Ready: when it is exposed, and as the answer to a Ping of a
//    permitted origin.
// 3. The embedding page answers with Connect and a MessagePort, to the origin that it expects. All other
//    messages go through the port: Requests and their Replies; Events, of which "connect" is the first; and
//    End when the player is no longer exposed.
import type { CameraView } from "../element/cameras/rig";
import type { Quality } from "../player/adaptation";
import type { LiveState } from "../types";

export const VERSION = 1;

/** The messages between the windows; Connect has one port. */
export interface WindowMessage {
  stgs: "ping" | "ready" | "connect";
  version: number;
  /** In Ready: differs for each load of the page, so that each is connected to once. */
  page?: string;
}

/** The state of the player, sent with each event. Times are in seconds; `duration` is null while unknown. */
export interface RemoteState {
  currentTime: number;
  duration: number | null;
  paused: boolean;
  ended: boolean;
  seeking: boolean;
  readyState: number;
  playbackRate: number;
  loop: boolean;
  muted: boolean;
  volume: number;
  hasAudio: boolean;
  quality: Quality;
  /** See `StgsPlayer.live`. */
  live: LiveState | null;
  /** The message of the error that ended playback; null if there was no error. */
  error: string | null;
}

/** The properties that can be set. */
export type Settings = Pick<RemoteState, "playbackRate" | "loop" | "muted" | "volume" | "quality">;

/** The methods that can be called, with their arguments and results. */
export interface Methods {
  play(): void;
  pause(): void;
  seek(seconds: number): void;
  goLive(): void;
  set<K extends keyof Settings>(name: K, value: Settings[K]): void;
  camera(): CameraView;
  setCamera(view: CameraView): void;
  resetCamera(): void;
}

export interface Request {
  id: number; // an integer from 0 on
  method: keyof Methods;
  args: unknown[]; // at most 2
}

export interface Reply {
  type: "reply";
  id: number;
  value?: unknown;
  error?: { name: string; message: string };
}

export interface RemoteEvent {
  type: "event";
  /** An event of the player, or "connect". */
  name: string;
  /** The detail of `notice` and `qualitychange`. */
  detail?: unknown;
  state: RemoteState;
}

/** The last message: the page with the player has closed the connection. */
export interface RemoteEnd {
  type: "end";
}

/** Whether a message is an object with members. */
export function isRecord(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

/** Returns the kind of a message between windows; null if it is not part of this protocol. */
export function windowMessage(data: unknown): WindowMessage["stgs"] | null {
  if (!isRecord(data) || data["version"] !== VERSION) return null;
  const kind = data["stgs"];
  return kind === "ping" || kind === "ready" || kind === "connect" ? kind : null;
}

/** Throws a TypeError unless this is an origin such as "https://page.example". */
export function checkOrigin(origin: string): string {
  let parsed = "";
  try {
    parsed = new URL(origin).origin;
  } catch {
    // below
  }
  if (parsed !== origin || origin === "null")
    throw new TypeError(`"${origin}" is not an origin (expected one such as https://page.example)`);
  return origin;
}
