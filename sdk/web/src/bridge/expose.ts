// SPDX-License-Identifier: Apache-2.0
// The page with the player: executes requests of the page that embeds it.
import type { CameraView } from "../element/cameras/rig";
import { QUALITIES } from "../player/adaptation";
import type { Quality } from "../player/adaptation";
import { errorOf } from "../player/errors";
import { EVENT_NAMES } from "../player/event_queue";
import type { LiveState } from "../types";
import { checkOrigin, isRecord, RemoteEnd, RemoteEvent, RemoteState, Reply, Request, VERSION, windowMessage, WindowMessage } from "./protocol";

/** The exposed part of a player or an element. Only elements have a camera. */
export interface Exposable extends EventTarget {
  currentTime: number;
  playbackRate: number;
  loop: boolean;
  muted: boolean;
  volume: number;
  quality: Quality;
  readonly duration: number;
  readonly paused: boolean;
  readonly ended: boolean;
  readonly seeking: boolean;
  readonly readyState: number;
  readonly hasAudio: boolean;
  readonly live: LiveState | null;
  readonly error: { message: string } | null;
  cameraView?: CameraView | null;
  play(): Promise<void>;
  pause(): void;
  goLive(): void;
  resetCamera?(): void;
}

const MAX_PENDING = 32; // requests
const MAX_TEXT = 1000; // characters of a message
const MAX_NUMBER = 1e9; // in magnitude

let isExposed = false; // a player of this page

function stateOf(player: Exposable): RemoteState {
  const { currentTime, paused, ended, seeking, readyState, playbackRate, loop, muted, volume, hasAudio, quality, live } = player;
  const duration = Number.isFinite(player.duration) ? player.duration : null;
  const error = player.error?.message.slice(0, MAX_TEXT) ?? null;
  return { currentTime, duration, paused, ended, seeking, readyState, playbackRate, loop, muted, volume, hasAudio, quality, live, error };
}

function numberOf(value: unknown): number {
  if (typeof value !== "number" || !(Math.abs(value) <= MAX_NUMBER))
    throw new TypeError(`expected a number from ${-MAX_NUMBER} to ${MAX_NUMBER}`);
  return value;
}

function booleanOf(value: unknown): boolean {
  if (typeof value !== "boolean") throw new TypeError("expected true or false");
  return value;
}

function viewOf(value: unknown): CameraView {
  const point = isRecord(value) ? value["point"] : null;
  if (!isRecord(value) || !Array.isArray(point) || point.length !== 3) throw new TypeError("expected a camera view");
  return {
    azimuth: numberOf(value["azimuth"]), elevation: numberOf(value["elevation"]), distance: numberOf(value["distance"]),
    point: [numberOf(point[0]), numberOf(point[1]), numberOf(point[2])],
  };
}

function setting(player: Exposable, name: unknown, value: unknown): void {
  switch (name) {
    case "playbackRate":
    case "volume":
      player[name] = numberOf(value);
      return;
    case "loop":
    case "muted":
      player[name] = booleanOf(value);
      return;
    case "quality":
      if (!QUALITIES.includes(value as Quality)) throw new TypeError(`expected one of ${QUALITIES.join(", ")}`);
      player.quality = value as Quality;
      return;
  }
  throw new TypeError("unknown property, or it cannot be set");
}

function camera(player: Exposable): CameraView {
  const view = player.cameraView;
  if (!view) throw new DOMException("the player has no camera yet", "InvalidStateError");
  return view;
}

type Handler = (player: Exposable, args: unknown[]) => unknown;

const HANDLERS = new Map<unknown, Handler>([
  ["play", (player) => player.play()],
  ["pause", (player) => player.pause()],
  ["seek", (player, [seconds]) => void (player.currentTime = numberOf(seconds))],
  ["goLive", (player) => player.goLive()],
  ["set", (player, [name, value]) => setting(player, name, value)],
  ["camera", (player) => camera(player)],
  ["setCamera", (player, [view]) => {
    camera(player);
    player.cameraView = viewOf(view);
  }],
  ["resetCamera", (player) => player.resetCamera?.()],
]);

/** Returns a request if a message is one. */
function requestOf(data: unknown): Request | null {
  if (!isRecord(data) || !Array.isArray(data["args"]) || data["args"].length > 2) return null;
  const { id, method, args } = data as unknown as Request;
  return Number.isSafeInteger(id) && id >= 0 && HANDLERS.has(method) ? { id, method, args } : null;
}

/** Answers the requests of one port, and sends the events of the player, until close(). */
class Connection {
  private pending = 0;
  private readonly abort = new AbortController();

  constructor(private readonly player: Exposable, private readonly port: MessagePort) {
    for (const name of EVENT_NAMES) {
      player.addEventListener(name, (event) => this.sendEvent(name, event), { signal: this.abort.signal });
    }
    port.onmessage = ({ data }) => {
      const request = requestOf(data);
      if (request !== null) void this.answer(request);
    };
    this.post({ type: "event", name: "connect", state: stateOf(player) });
  }

  close(): void {
    this.abort.abort();
    this.post({ type: "end" });
    this.port.close();
  }

  private sendEvent(name: string, event: Event): void {
    const detail: unknown = (event as CustomEvent).detail ?? null;
    const more = detail === null ? {} : { detail };
    this.post({ type: "event", name, state: stateOf(this.player), ...more });
  }

  private async answer({ id, method, args }: Request): Promise<void> {
    try {
      if (this.pending >= MAX_PENDING) throw new DOMException("too many requests are pending", "QuotaExceededError");
      ++this.pending;
      try {
        this.post({ type: "reply", id, value: await HANDLERS.get(method)!(this.player, args) });
      } finally {
        --this.pending;
      }
    } catch (error) {
      const { name, message } = errorOf(error);
      this.post({ type: "reply", id, error: { name, message: message.slice(0, MAX_TEXT) } });
    }
  }

  private post(message: Reply | RemoteEvent | RemoteEnd): void {
    this.port.postMessage(message);
  }
}

/**
 * Lets the page that embeds this one control a player, if its origin is in the list, such as
 * "https://page.example". Returns a function that ends this. Throws a TypeError if an entry is not an
 * origin, and an InvalidStateError if the page already exposes another player.
 */
export function expose(player: Exposable, origins: readonly string[]): () => void {
  const permitted = origins.map(checkOrigin);
  if (isExposed) throw new DOMException("this page already exposes another player", "InvalidStateError");
  isExposed = true;
  const { parent } = window;
  const ready: WindowMessage = { stgs: "ready", version: VERSION, page: String(Math.random()) };
  let connection: Connection | null = null;
  const onMessage = (event: MessageEvent): void => {
    // Messages from other origins are ignored.
    if (event.source !== parent || !permitted.includes(event.origin)) return;
    const kind = windowMessage(event.data);
    if (kind === "ping") parent.postMessage(ready, event.origin);
    const [port] = event.ports;
    if (kind !== "connect" || port === undefined) return;
    connection?.close();
    connection = new Connection(player, port);
  };
  if (parent !== window) {
    window.addEventListener("message", onMessage);
    parent.postMessage(ready, "*"); // contains nothing private
  }
  return () => {
    isExposed = false;
    window.removeEventListener("message", onMessage);
    connection?.close();
  };
}
