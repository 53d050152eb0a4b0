// SPDX-License-Identifier: Apache-2.0
// The page that embeds a player: controls it through a port.
import type { CameraView } from "../element/cameras/rig";
import { EVENT_NAMES } from "../player/event_queue";
import { checkOrigin, isRecord, Methods, Reply, RemoteEvent, RemoteState, Settings, VERSION, windowMessage, WindowMessage } from "./protocol";

const TIMEOUT = 10_000; // milliseconds
const MAX_PENDING = 32; // requests

/** Settings of connect(). */
export interface ConnectOptions {
  /** The origin of the embedded page; default: that of the `src` of the frame. */
  origin?: string;
  /** Milliseconds until connecting fails; default 10,000. */
  timeout?: number;
  /** Aborts connecting, or closes the connection later. */
  signal?: AbortSignal;
}

interface Waiter {
  resolve(value: unknown): void;
  reject(error: Error): void;
}

/**
 * A player in a frame. It dispatches the events of the player as `CustomEvent`s with the same `detail`, and
 * `connect` after each load of the embedded page. Promises resolve when the player has answered. They reject
 * with the error of the player, or with an `AbortError` if the embedded page is reloaded or closes the
 * connection, or `close` is called.
 */
export class RemotePlayer extends EventTarget {
  private port: MessagePort | null = null;
  private latest: RemoteState | null = null;
  private readonly waiting = new Map<number, Waiter>();
  private nextId = 0;

  constructor(private readonly onClose: () => void) {
    super();
  }

  /** The state at the last event; null before the first one. The embedded page provides it: do not trust its values. */
  get state(): RemoteState | null {
    return this.latest;
  }

  /** Resolves when the time advances. */
  play(): Promise<void> {
    return this.call("play");
  }
  pause(): Promise<void> {
    return this.call("pause");
  }
  /** Seeks to a time in seconds; the event `seeked` follows. */
  seek(seconds: number): Promise<void> {
    return this.call("seek", seconds);
  }
  /** See `StgsPlayer.goLive`. */
  goLive(): Promise<void> {
    return this.call("goLive");
  }
  set<K extends keyof Settings>(name: K, value: Settings[K]): Promise<void> {
    return this.call("set", name, value);
  }
  camera(): Promise<CameraView> {
    return this.call("camera");
  }
  /** Moves the camera, within its limits. */
  setCamera(view: CameraView): Promise<void> {
    return this.call("setCamera", view);
  }
  resetCamera(): Promise<void> {
    return this.call("resetCamera");
  }

  /** Closes the connection. */
  close(): void {
    this.adopt(null);
    this.onClose();
  }

  /** Uses another port, or none. For `connect`. */
  adopt(port: MessagePort | null): void {
    if (this.port !== null) {
      this.port.onmessage = null;
      this.port.close();
    }
    this.port = port;
    for (const { reject } of this.waiting.values()) reject(new DOMException("the connection to the player ended", "AbortError"));
    this.waiting.clear();
    if (port !== null) port.onmessage = ({ data }) => this.receive(data);
  }

  private call<T>(method: keyof Methods, ...args: unknown[]): Promise<T> {
    return new Promise<T>((resolve, reject) => {
      if (this.port === null) throw new DOMException("there is no connection to the player", "InvalidStateError");
      if (this.waiting.size >= MAX_PENDING) throw new DOMException("too many requests are pending", "QuotaExceededError");
      const id = this.nextId++;
      this.waiting.set(id, { resolve: resolve as (value: unknown) => void, reject });
      this.port.postMessage({ id, method, args });
    });
  }

  private receive(data: unknown): void {
    if (!isRecord(data)) return;
    if (data["type"] === "reply") return this.finishRequest(data as unknown as Reply);
    if (data["type"] === "end") return this.adopt(null);
    const { type, name, state, detail } = data as unknown as RemoteEvent;
    const isKnown = name === "connect" || (EVENT_NAMES as readonly unknown[]).includes(name);
    if (type !== "event" || !isKnown || !isRecord(state)) return;
    this.latest = state;
    this.dispatchEvent(new CustomEvent(name, { detail: detail ?? null }));
  }

  private finishRequest({ id, value, error }: Reply): void {
    const waiter = this.waiting.get(id);
    this.waiting.delete(id);
    if (error === undefined) waiter?.resolve(value);
    else waiter?.reject(new DOMException(String(error.message), String(error.name)));
  }
}

/**
 * Connects to the player of an embedded page, which has exposed it to the origin of this page. Resolves
 * once the player has answered. Rejects with a `TimeoutError`, with the reason of the signal, or with a TypeError
 * if the frame has no origin.
 */
export function connect(
  frame: HTMLIFrameElement, { origin = new URL(frame.src, document.baseURI).origin, timeout = TIMEOUT, signal }: ConnectOptions = {},
): Promise<RemotePlayer> {
  return new Promise((resolve, reject) => {
    checkOrigin(origin);
    const player = new RemotePlayer(() => {
      window.removeEventListener("message", onMessage);
      signal?.removeEventListener("abort", onAbort);
    });
    let page: unknown = null; // the load of the page that the player is connected to
    const send = (stgs: WindowMessage["stgs"], to: string, ports: MessagePort[] = []): void => {
      const message: WindowMessage = { stgs, version: VERSION };
      frame.contentWindow?.postMessage(message, to, ports);
    };
    const onMessage = (event: MessageEvent): void => {
      if (event.source !== frame.contentWindow || event.origin !== origin || windowMessage(event.data) !== "ready") return;
      const ready = event.data as WindowMessage;
      if (ready.page === page) return;
      page = ready.page;
      const { port1, port2 } = new MessageChannel();
      player.adopt(port1);
      send("connect", origin, [port2]);
    };
    const end = (error: unknown): void => {
      clearTimeout(timer);
      player.close();
      reject(error);
    };
    const onAbort = () => end(signal!.reason);
    const timer = setTimeout(() => {
      const message = `no player on ${origin} answers; its page must permit ${location.origin} (attribute bridge)`;
      end(new DOMException(message, "TimeoutError"));
    }, timeout);
    player.addEventListener("connect", () => {
      clearTimeout(timer);
      resolve(player);
    });
    if (signal?.aborted) return end(signal.reason);
    signal?.addEventListener("abort", onAbort);
    window.addEventListener("message", onMessage);
    send("ping", "*"); // has no content
  });
}
