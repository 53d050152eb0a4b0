// SPDX-License-Identifier: Apache-2.0
// Reads ranges of a file from a server, or of a Blob.
import type { FileStart } from "../types";

/** A read that failed. `retry`: another attempt may succeed. */
export class ReadError extends Error {
  constructor(message: string, readonly retry: boolean, readonly code: "network" | "unsupported" | "aborted") {
    super(message);
  }
}

/** Access to a file. */
export interface RangeReader {
  /** The name of the file in messages. */
  readonly name: string;
  /** URL of the file, after redirects once it was read; "" for a Blob. */
  readonly url: string;
  /** Reads the first bytes: `bytes`, or as many as there are. */
  readStart(bytes: number, signal: AbortSignal): Promise<FileStart>;
  /** Reads exactly `to.length` bytes from `offset` on. Returns the size of the file. */
  read(offset: number, to: Uint8Array, signal: AbortSignal): Promise<number>;
  /** Whether the file may grow. */
  readonly mayGrow: boolean;
  /**
   * States that the first `bytes` of the file do not change, while more are appended; Infinity: the file is
   * complete, and any change is an error. Throws if it has already changed.
   */
  setStable(bytes: number): void;
}

/** A read fails if fewer than this many bytes of the response arrive in so many seconds. */
const STALL_BYTES = 1000, STALL_SECONDS = 10;
/** Seconds after which a read fails in any case: these, and one for so many bytes of it. */
const READ_SECONDS = 60, READ_BYTES_PER_SECOND = 1000;

/** Bytes read first, which suffice to open most files. */
export const OPEN_BYTES = 1 << 16;

/** Returns the reader of a URL or Blob. `known`: its start, if it has already been read. */
export function rangeReader(source: string | Blob, known: FileStart | null = null): RangeReader {
  return typeof source === "string" ? new UrlReader(source, known) : new BlobReader(source);
}

class BlobReader implements RangeReader {
  readonly name: string;
  readonly mayGrow = false;
  readonly url = "";
  constructor(private readonly blob: Blob) {
    this.name = blob instanceof File ? blob.name : "scene";
  }
  async readStart(bytes: number, signal: AbortSignal): Promise<FileStart> {
    const { size } = this.blob;
    const head = new Uint8Array(Math.min(bytes, size));
    await this.read(0, head, signal);
    return { head, size, version: "", url: "" };
  }
  setStable(): void {} // any change is an error
  async read(offset: number, to: Uint8Array, signal: AbortSignal): Promise<number> {
    const changed = `${this.name}: cannot be read, or has changed; choose it again`;
    const bytes = await this.blob.slice(offset, offset + to.length).arrayBuffer().catch(() => {
      throw new ReadError(changed, false, "network");
    });
    if (signal.aborted) throw aborted();
    if (bytes.byteLength !== to.length) throw new ReadError(changed, false, "network");
    to.set(new Uint8Array(bytes));
    return this.blob.size;
  }
}

function aborted(): ReadError {
  return new ReadError("the read was cancelled", false, "aborted");
}

class UrlReader implements RangeReader {
  readonly name: string;
  readonly mayGrow = true;
  /** Validator of the last response; null before the first response. */
  private version: string | null;
  private known: number | null; // size of the file
  private stable: number | null = null; // as setStable(); null: while the file is opened
  private hasChanged = false; // since it was opened
  url: string;

  /** `known`: the start of the file, if it has already been read. */
  constructor(private readonly address: string, known: FileStart | null) {
    this.version = known?.version ?? null;
    this.known = known?.size ?? null;
    this.url = known?.url ?? address;
    this.name = address.split(/[?#]/)[0].split("/").pop() || "scene";
  }

  readStart(bytes: number, signal: AbortSignal): Promise<FileStart> {
    return this.request(0, bytes, signal, async (response, watch, stable) => {
      const { size, length } = this.check(response, 0, bytes, true, stable);
      const head = new Uint8Array(length);
      await this.body(response, head, watch);
      return { head, size, version: this.version!, url: response.url };
    });
  }

  read(offset: number, to: Uint8Array, signal: AbortSignal): Promise<number> {
    return this.request(offset, to.length, signal, async (response, watch, stable) => {
      const { size } = this.check(response, offset, to.length, false, stable);
      await this.body(response, to, watch);
      return size;
    });
  }

  setStable(bytes: number): void {
    if (bytes === Infinity && this.stable === null && this.hasChanged) throw this.replaced();
    // Closing a recording changes its version.
    if (bytes === Infinity && this.stable !== null && this.stable !== Infinity) this.version = null;
    this.stable = bytes;
  }

  /** Requests `length` bytes; `receive` takes the response. `stable`: as setStable(), at the request. */
  private async request<T>(offset: number, length: number, signal: AbortSignal,
                           receive: (response: Response, watch: Watch, stable: number | null) => Promise<T>): Promise<T> {
    const watch = new Watch(signal, READ_SECONDS + length / READ_BYTES_PER_SECOND);
    const { stable } = this;
    // A cache may return the earlier size of a growing file.
    const cache = stable === null || stable === Infinity ? "default" : "no-store";
    try {
      const headers = { Range: `bytes=${offset}-${offset + length - 1}` };
      const response = await fetch(this.address, { headers, signal: watch.signal, cache });
      const result = await receive(response, watch, stable);
      this.url = response.url;
      return result;
    } catch (error) {
      watch.cancel(); // the rest of the response
      if (signal.aborted) throw aborted();
      if (error instanceof ReadError) throw error;
      const why = watch.failure ?? String((error as Error).message);
      throw new ReadError(`${this.name}: ${why}; check the address, the network and that the server allows this page (CORS)`, true, "network");
    } finally {
      watch.end();
    }
  }

  /**
   * Checks the headers of a response to a request of `length` bytes. Returns the size of the file, and
   * the length of the response, which may be less only if `isStart` and the file is shorter.
   * `stable`: as setStable(), at the request.
   */
  private check(response: Response, offset: number, length: number, isStart: boolean, stable: number | null): { size: number; length: number } {
    const last = offset + length - 1;
    const fail = (why: string, retry: boolean, code: "network" | "unsupported" = "network") =>
      new ReadError(`${this.name}: ${why}`, retry, code);
    if (response.status === 404 || response.status === 410) throw fail(`the server has no such file (status ${response.status}); check the address`, false);
    if (response.status === 200) throw fail("the server does not support range requests; use one that does, such as nginx", false, "unsupported");
    const grows = stable !== null && stable !== Infinity; // a recorder that resumes may cut the bytes beyond
    if (response.status === 416) throw fail("the file is empty or shorter than before; load it again", grows && offset >= stable);
    if (response.status === 401 || response.status === 403)
      throw fail(`the server refuses access (status ${response.status}); log in, or check the permissions of the file`, false);
    if (response.status !== 206) throw fail(`the server answers with status ${response.status}`, response.status >= 500 || response.status === 429);
    const stated = response.headers.get("Content-Range");
    const range = /^bytes (\d+)-(\d+)\/(\d+)$/.exec(stated ?? "");
    if (stated !== null && range === null) throw fail(`the server does not state the size of the file (Content-Range: ${stated})`, false, "unsupported");
    if (range === null) throw fail("the server hides Content-Range from this page; it must send Access-Control-Expose-Headers: Content-Range, ETag", false, "unsupported");
    const [begin, end, size] = range.slice(1).map(Number);
    if (!Number.isSafeInteger(size)) throw fail(`the server states a size of ${range[3]} bytes; check the server`, false, "unsupported");
    if (begin !== offset || end > last || (isStart && end !== Math.min(last, size - 1))) throw fail("the server sent another range than requested", true);
    if (end !== last && !isStart) throw fail("the file is shorter than before; load it again", grows && size >= stable);
    const version = response.headers.get("ETag") ?? response.headers.get("Last-Modified") ?? "";
    this.checkVersion(version, size, stable);
    return { size, length: end - begin + 1 };
  }

  /** Checks that a response belongs to the file that was opened. `stable`: at the request. */
  private checkVersion(version: string, total: number, stable: number | null): void {
    if (this.version !== null) {
      const isSame = version === this.version && total === this.known;
      const kept = stable ?? this.known!;
      const isKept = total > kept || (total === kept && total !== this.known);
      if (!isSame && !isKept) throw this.replaced();
      this.hasChanged ||= !isSame;
    }
    if (this.stable === Infinity && stable !== Infinity) return; // requested before the file was complete
    this.version = version;
    this.known = total;
  }

  private replaced(): ReadError {
    return new ReadError(`${this.name}: the file was replaced; load it again`, false, "network");
  }

  private async body(response: Response, to: Uint8Array, watch: Watch): Promise<void> {
    const reader = response.body!.getReader();
    let at = 0;
    for (;;) {
      const { done, value } = await reader.read();
      if (done) break;
      watch.progress(value.length);
      if (at + value.length > to.length) throw new ReadError(`${this.name}: the server sent more than requested`, true, "network");
      to.set(value, at);
      at += value.length;
    }
    if (at !== to.length) throw new ReadError(`${this.name}: the connection ended early`, true, "network");
  }
}

/** Aborts a request if its caller does, if almost nothing arrives for STALL_SECONDS, or after `seconds`. */
class Watch {
  private readonly controller = new AbortController();
  private readonly forward = () => this.controller.abort();
  private readonly total: ReturnType<typeof setTimeout>;
  private stall: ReturnType<typeof setTimeout> | undefined;
  private bytes = 0; // since the stall timer was started
  /** Why the request was aborted, if not by its caller. */
  failure: string | null = null;

  constructor(private readonly outer: AbortSignal, seconds: number) {
    if (outer.aborted) this.controller.abort();
    outer.addEventListener("abort", this.forward);
    this.total = setTimeout(() => this.fail(`not complete after ${Math.round(seconds)} s`), 1000 * seconds);
    this.restart();
  }
  get signal(): AbortSignal {
    return this.controller.signal;
  }
  /** More bytes have arrived. */
  progress(bytes: number): void {
    this.bytes += bytes;
    if (this.bytes >= STALL_BYTES) this.restart();
  }
  cancel(): void {
    this.controller.abort();
  }
  end(): void {
    clearTimeout(this.stall);
    clearTimeout(this.total);
    this.outer.removeEventListener("abort", this.forward);
  }

  private restart(): void {
    this.bytes = 0;
    clearTimeout(this.stall);
    this.stall = setTimeout(() => this.fail(`almost no data for ${STALL_SECONDS} s`), 1000 * STALL_SECONDS);
  }

  private fail(why: string): void {
    this.failure = why;
    this.controller.abort();
  }
}
