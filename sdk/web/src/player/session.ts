// SPDX-License-Identifier: Apache-2.0
// One source that is being loaded or played, and its promises.
import { abortError } from "./errors";

interface Waiter {
  resolve(): void;
  reject(reason: unknown): void;
}

/** Promises that a later event resolves or rejects together. */
export class Waiters {
  private waiters: Waiter[] = [];

  wait(): Promise<void> {
    return new Promise((resolve, reject) => this.waiters.push({ resolve, reject }));
  }

  resolve(): void {
    for (const waiter of this.drain()) waiter.resolve();
  }

  reject(reason: unknown): void {
    for (const waiter of this.drain()) waiter.reject(reason);
  }

  private drain(): Waiter[] {
    const waiters = this.waiters;
    this.waiters = [];
    return waiters;
  }
}

/** The promise of a source, from `load` to the next `load`, an error, an abort or `destroy`. */
export class Session {
  /** Resolves when the scene is open. */
  readonly opened: Promise<void>;
  private readonly opening = new Waiters();
  private unlisten: () => void = () => undefined;

  constructor() {
    this.opened = this.opening.wait();
    // Callers that set `src` have no promise; the error event reports failures to them.
    this.opened.catch(() => undefined);
  }

  /** Calls `onAbort` if the signal is aborted before the scene is open. */
  listen(signal: AbortSignal, onAbort: () => void): void {
    signal.addEventListener("abort", onAbort);
    this.unlisten = () => signal.removeEventListener("abort", onAbort);
  }

  markOpen(): void {
    this.unlisten();
    this.opening.resolve();
  }

  /** Ends the session; has no effect on a promise that is resolved. */
  end(reason: unknown = abortError("the source was replaced or removed")): void {
    this.unlisten();
    this.opening.reject(reason);
  }
}

/** The URL for the worker, whose own base URL may be another one. */
export function absoluteSource(source: string | Blob): string | Blob {
  if (typeof source !== "string" || typeof document === "undefined") return source;
  try {
    return new URL(source, document.baseURI).href;
  } catch {
    return source; // the core reports that it is invalid
  }
}
