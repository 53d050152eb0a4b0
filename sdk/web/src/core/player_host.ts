// SPDX-License-Identifier: Apache-2.0
// Runs the core in a worker: reads for it, steps it, and reports to the page.
import type { CoreMessage, PageMessage, SceneInfo } from "../types";
import { Core, CoreHost, CoreInfo, OutOfMemory } from "./module";
import { RangeReader, rangeReader, ReadError } from "./range_reader";

/** Seconds of decoding between two looks at the messages of the page. */
const STEP_SECONDS = 0.02;
/** Milliseconds between two steps while playing, and between two reports of an unchanged state. */
const PLAY_INTERVAL = 10, REPORT_INTERVAL = 250;
/** Bytes read at a time while a file is opened: at least this many from the first that is missing. */
const OPEN_BYTES = 1 << 16;
const OPEN_ATTEMPTS = 4;

type OpenMessage = Extract<PageMessage, { type: "open" }>;

/** One player. `post` sends a message to the page and passes the ownership of `transfer`. */
export class PlayerHost implements CoreHost {
  private core: Core | null = null;
  private reader: RangeReader | null = null;
  private readonly reads = new Map<number, AbortController>();
  private readonly closed = new AbortController();
  private timer: ReturnType<typeof setTimeout> | undefined;
  private opened = false;
  private rate = 1;
  private shDegree = 0;
  private duration = 0;
  private lastState = "";
  private reportedAt = 0;

  constructor(private readonly module: Promise<WebAssembly.Module>,
              private readonly post: (message: CoreMessage, transfer: Transferable[]) => void) {}

  /** Handles a message of the page. */
  handle(message: PageMessage): void {
    switch (message.type) {
      case "open":
        void this.open(message);
        return;
      case "close":
        this.close();
        return;
    }
    if (!this.opened || this.core === null) return;
    switch (message.type) {
      case "play":
        this.core.play();
        break;
      case "pause":
        this.core.pause();
        break;
      case "seek":
        if (!this.core.seek(message.seconds)) return;
        break;
      case "rate":
        if (!this.core.setRate(message.rate)) return;
        this.rate = message.rate;
        break;
      case "loop":
        this.core.setLoop(message.loop);
        break;
    }
    this.lastState = "";
    this.schedule(0);
  }

  /** CoreHost. */
  read(id: number, offset: number, bytes: number, address: number): void {
    const controller = new AbortController();
    this.reads.set(id, controller);
    const to = new Uint8Array(bytes);
    this.reader!.read(offset, to, controller.signal).then(
      () => this.readEnded(id, "", address, to),
      (error: unknown) => this.readEnded(id, String((error as Error).message), address, to));
  }
  cancel(id: number): void {
    this.reads.get(id)?.abort();
  }

  private readEnded(id: number, failure: string, address: number, bytes: Uint8Array): void {
    if (this.core === null || !this.reads.delete(id)) return;
    if (failure === "") this.core.bytes(address, bytes.length).set(bytes);
    this.core.readDone(id, failure);
    this.schedule(0);
  }

  private async open(message: OpenMessage): Promise<void> {
    try {
      const info = await this.openFile(message);
      if (this.closed.signal.aborted) return;
      this.opened = true;
      this.shDegree = info.shDegree;
      this.duration = info.duration;
      this.post({ type: "opened", info: sceneInfo(info) }, []);
      this.schedule(0);
    } catch (error) {
      if (!this.closed.signal.aborted) this.fail(error);
    }
  }

  private async openFile(message: OpenMessage): Promise<CoreInfo> {
    const reader = (this.reader = rangeReader(message.source));
    const signal = this.closed.signal;
    const [module, size] = await Promise.all([this.module, withRetry(() => reader.size(signal), signal)]);
    const core = (this.core = await Core.create(module, this));
    core.open(reader.name, size, message.options.memoryBudget, message.options.lookAhead);
    for (;;) {
      if (signal.aborted) throw new ReadError("closed", false, "aborted");
      const result = core.tryOpen();
      if ("info" in result) return result.info;
      if ("message" in result) throw new CoreError(result.code, result.message);
      const [offset, missing] = result.missing;
      const bytes = new Uint8Array(Math.min(Math.max(missing, OPEN_BYTES), size - offset));
      await withRetry(() => reader.read(offset, bytes, signal), signal);
      core.provide(offset, bytes);
    }
  }

  private schedule(milliseconds: number): void {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.step(), milliseconds);
  }

  private step(): void {
    if (this.core === null) return;
    try {
      const at = performance.now(); // the position is that of the beginning of the step
      const wait = this.core.step(STEP_SECONDS);
      this.sendChanges();
      const early = this.report(at);
      const next = this.lastState === "playing" || this.lastState === "buffering" ? PLAY_INTERVAL : Infinity;
      const due = Math.min(wait * 1000, next, early);
      if (Number.isFinite(due)) this.schedule(due);
    } catch (error) {
      this.fail(error);
    }
  }

  private sendChanges(): void {
    const core = this.core!;
    for (let change = core.nextChange(); change !== null; change = core.nextChange()) {
      if (change.primitives === 0) {
        this.post({ type: "dropped", id: change.id }, []);
        continue;
      }
      this.post({ type: "segment", segment: { ...change, shDegree: this.shDegree } }, [change.words]);
    }
  }

  /** Reports the state as of `at`. Returns milliseconds: once they have passed, it is due. */
  private report(at: number): number {
    const core = this.core!;
    for (const event of core.events()) this.post({ type: "event", kind: event.kind, message: event.message }, []);
    const state = core.state();
    const now = performance.now();
    const early = REPORT_INTERVAL - (now - this.reportedAt);
    if (state.state === this.lastState && early > 0) return early;
    this.lastState = state.state;
    this.reportedAt = now;
    this.post({
      type: "state", state: state.state, seconds: state.seconds, at: performance.timeOrigin + at, rate: this.rate,
      buffered: state.buffered, layers: state.layers, layerCount: state.layerCount, bytes: state.bytes, duration: this.duration,
    }, []);
    return Infinity;
  }

  private fail(error: unknown): void {
    this.close();
    this.post({ type: "error", code: codeOf(error), message: textOf(error) }, []);
  }

  private close(): void {
    this.closed.abort();
    clearTimeout(this.timer);
    for (const controller of this.reads.values()) controller.abort();
    this.reads.clear();
    this.core = null; // with it, the memory of the module
    this.opened = false;
  }
}

/** An error of the core; `code`: StatusCode of stgs/format/status.h. */
class CoreError extends Error {
  constructor(readonly code: number, message: string) {
    super(message);
  }
}

/** The message of an error. What the C++ throws beyond its own errors, such as std::bad_alloc, has none. */
function textOf(error: unknown): string {
  if (error instanceof WebAssembly.RuntimeError) return `the decoder stopped (${error.message}); report the file`;
  return error instanceof Error ? error.message : "the decoder is out of memory; lower the memory budget";
}

type ErrorCode = Extract<CoreMessage, { type: "error" }>["code"];

function codeOf(error: unknown): ErrorCode {
  if (error instanceof ReadError) return error.code;
  if (error instanceof OutOfMemory || error instanceof RangeError || !(error instanceof Error)) return "memory";
  if (!(error instanceof CoreError)) return "unsupported";
  const names: Record<number, ErrorCode> = { 1: "usage", 2: "network", 3: "format", 8: "memory", 9: "memory" };
  return names[error.code] ?? "unsupported";
}

function sceneInfo(info: CoreInfo): SceneInfo {
  const { duration, tickSeconds, frames, shDegree, primitives, boundsMin, boundsMax, background, startCamera } = info;
  const up = info.up.some((v) => v !== 0) ? info.up : null;
  return { duration, tickSeconds, frames, shDegree, primitives, boundsMin, boundsMax, up, background, startCamera };
}

/** Repeats a read that may succeed later, with growing pauses. */
async function withRetry<T>(read: () => Promise<T>, signal: AbortSignal): Promise<T> {
  for (let attempt = 1; ; ++attempt) {
    try {
      return await read();
    } catch (error) {
      if (!(error instanceof ReadError) || !error.retry || attempt === OPEN_ATTEMPTS || signal.aborted) throw error;
      await new Promise((resolve) => setTimeout(resolve, 200 * 2 ** attempt));
    }
  }
}
