// SPDX-License-Identifier: Apache-2.0
// Runs the core in a worker: reads for it, steps it, and reports to the page.
import type { CoreMessage, FileStart, PageMessage, ReadFailure, SceneInfo } from "../types";
import { DecoderPool } from "./decoder_pool";
import type { DecoderPoolOwner, DecoderThread } from "./decoder_pool";
import { LoadMarks } from "../marks";
import { decoderProblem, isOutOfMemory, OutOfMemory } from "./instance";
import { Core } from "./module";
import type { CoreHost, CoreInfo, CoreState, DecodeJob, DecodeStatus, FilePiece } from "./module";
import type { Part } from "./part_decoder";
import { OPEN_BYTES, RangeReader, rangeReader, ReadError } from "./range_reader";
import { ShownParts } from "./shown_parts";

/** Decoding workers, at most. One processor is left to the page. */
const MAX_DECODERS = 4;
/** Seconds of work between two looks at the messages of the page. */
const STEP_SECONDS = 0.02;
/** Milliseconds between two steps while playing, and between two reports of an unchanged state. */
const PLAY_INTERVAL = 10, REPORT_INTERVAL = 250;
const OPEN_ATTEMPTS = 4;
/** Bytes read of a file with another magic, at most, for the message about it. */
const MAX_FOREIGN_BYTES = 1 << 20;
const MAGIC = [0x89, 0x53, 0x54, 0x47]; // the first bytes (spec 2.1)
const FOREIGN = "not an .stgs file; choose another one, or convert it with 'stgs convert'";
const USAGE = 1, INVALID_FILE = 3; // StatusCode of stgs/format/status.h
/** The least and the greatest memory budget, bytes: addresses have 32 bits. */
const MIN_BUDGET = 1 << 20, MAX_BUDGET = 2 ** 31;

type OpenMessage = Extract<PageMessage, { type: "open" }>;

/** One player. `post` sends a message to the page and passes the ownership of `transfer`. */
export class PlayerHost implements CoreHost, DecoderPoolOwner {
  private core: Core | null = null;
  private pool: DecoderPool | null = null;
  private parts: ShownParts | null = null; // once the file is open
  private reader: RangeReader | null = null;
  private readonly reads = new Map<number, AbortController>();
  private closed = new AbortController(); // of the source that was opened last
  private timer: ReturnType<typeof setTimeout> | undefined;
  private rate = 1;
  private lastState = "";
  private lastSeek = 0;
  private reportedAt = 0;
  private readonly marks = new LoadMarks();
  private expected: { source: string; start: Promise<FileStart | ReadFailure | null> } | null = null;

  /** `startDecoder` starts a worker of decoderWorker(). */
  constructor(private readonly module: Promise<WebAssembly.Module>, private readonly startDecoder: () => DecoderThread,
              private readonly post: (message: CoreMessage, transfer: Transferable[]) => void) {
    this.marks.mark("worker");
  }

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
    if (this.parts === null || this.core === null) return;
    switch (message.type) {
      case "play":
        this.core.play();
        break;
      case "pause":
        this.core.pause();
        break;
      case "seek":
        this.lastSeek = message.id;
        this.core.seek(message.seconds); // an invalid time changes nothing
        break;
      case "rate":
        if (!this.core.setRate(message.rate)) return;
        this.rate = message.rate;
        break;
      case "loop":
        this.core.setLoop(message.loop);
        break;
      case "latency":
        this.core.setLatency(message.seconds); // an invalid value changes nothing
        break;
      case "maxPrimitives":
        this.core.limitPrimitives(message.primitives);
        break;
    }
    this.lastState = "";
    this.schedule(0);
  }

  /** Announces the source that is opened next, whose start the page reads. `start`: null if another attempt may succeed. */
  expect(source: string, start: Promise<FileStart | ReadFailure | null>): void {
    this.expected = { source, start };
  }

  /** CoreHost. */
  read(id: number, offset: number, bytes: number, address: number): void {
    const controller = new AbortController();
    this.reads.set(id, controller);
    const to = new Uint8Array(bytes);
    const isCurrent = () => this.reads.get(id) === controller; // each core counts its ids from the same start
    this.reader!.read(offset, to, controller.signal).then(
      (fileBytes) => {
        if (isCurrent()) this.readEnded(id, "", address, to, fileBytes);
      },
      (error: unknown) => {
        if (!isCurrent()) return; // closed
        if (error instanceof ReadError && !error.retry && error.code !== "aborted") this.fail(error);
        else this.readEnded(id, decoderProblem(error), address, to);
      });
  }
  cancel(id: number): void {
    this.reads.get(id)?.abort();
  }

  decode(job: DecodeJob): void {
    this.pool!.decode(job);
  }

  /** DecoderPoolOwner. */
  decoded(id: number, status: DecodeStatus, parts: Part[]): void {
    try {
      if (status.base.code === 0) {
        this.parts!.keep(id, parts);
        this.marks.mark("decoded");
      }
      this.core!.decodeDone(id, status);
      this.schedule(0);
    } catch (error) {
      this.fail(error);
    }
  }
  decodersFailed(message: string, outOfMemory: boolean): void {
    this.fail(outOfMemory ? new OutOfMemory(message) : new Error(message));
  }

  private readEnded(id: number, failure: string, address: number, bytes: Uint8Array, fileBytes = 0): void {
    this.reads.delete(id);
    try {
      if (failure === "") {
        this.core!.bytes(address, bytes.length).set(bytes);
        this.marks.mark("fetched");
      }
      this.core!.readDone(id, failure, fileBytes);
      this.schedule(0);
    } catch (error) {
      this.fail(error);
    }
  }

  private async open(message: OpenMessage): Promise<void> {
    this.close();
    const { signal } = (this.closed = new AbortController());
    this.marks.reset();
    this.rate = 1;
    this.lastState = "";
    this.lastSeek = 0;
    try {
      const info = await this.openFile(message, signal);
      if (signal.aborted) return;
      this.parts = new ShownParts(info.shDegree, this.post);
      this.state();
      this.post({ type: "opened", info: sceneInfo(info, this.reader!.url) }, []);
      this.marks.mark("opened");
      this.schedule(0);
    } catch (error) {
      if (!signal.aborted) this.fail(error);
    }
  }

  private async openFile(message: OpenMessage, signal: AbortSignal): Promise<CoreInfo> {
    const options = checked(message.options);
    const pool = (this.pool = new DecoderPool(decoders(), this.startDecoder, this));
    const known = await this.takeStart(message.source);
    if (signal.aborted) throw closed();
    const reader = (this.reader = rangeReader(message.source, known));
    const opening = known ?? withRetry(() => reader.readStart(OPEN_BYTES, signal), signal);
    const compiled = this.module.then((module) => (this.marks.mark("compiled"), module));
    const [module, { size, head }] = await Promise.all([compiled, opening]);
    const core = await Core.create(module, this);
    if (signal.aborted) throw closed();
    this.core = core;
    core.open(reader.name, size, reader.mayGrow, options, pool.capacity);
    const pieces: FilePiece[] = [];
    const provide = (offset: number, bytes: Uint8Array) => {
      core.provide(offset, bytes);
      pieces.push({ offset, bytes: bytes.buffer });
    };
    provide(0, head);
    const isForeign = !MAGIC.every((byte, i) => byte === head[i]);
    let read = head.length;
    for (;;) {
      const result = core.tryOpen();
      if ("info" in result) {
        pool.open(module, reader.name, size, options.memoryBudget, pieces);
        return result.info;
      }
      if ("message" in result) throw new CoreError(result.code, result.message);
      const [offset, length] = result.missing;
      if (isForeign && read + length > MAX_FOREIGN_BYTES) throw new CoreError(INVALID_FILE, `${reader.name}: ${FOREIGN}`);
      const bytes = new Uint8Array(length);
      await withRetry(() => reader.read(offset, bytes, signal), signal);
      if (signal.aborted) throw closed();
      provide(offset, bytes);
      read += length;
    }
  }

  /** Returns the start of a source if the page has read it; null if not, or if it was taken before. */
  private async takeStart(source: string | Blob): Promise<FileStart | null> {
    const { expected } = this;
    this.expected = null;
    const start = expected !== null && expected.source === source ? await expected.start : null;
    if (start !== null && "problem" in start) throw new ReadError(start.problem, false, start.code);
    return start;
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
      const isDone = this.sendChanges();
      const early = this.report(at);
      const next = this.lastState === "playing" || this.lastState === "buffering" ? PLAY_INTERVAL : Infinity;
      const due = isDone ? Math.min(wait * 1000, next, early) : 0;
      if (Number.isFinite(due)) this.schedule(due);
    } catch (error) {
      this.fail(error);
    }
  }

  /** Passes changes on for about STEP_SECONDS. Returns whether there are no more. */
  private sendChanges(): boolean {
    const core = this.core!, parts = this.parts!;
    const end = performance.now() + 1000 * STEP_SECONDS;
    let change = core.nextChange();
    for (; change !== null && performance.now() < end; change = core.nextChange()) parts.show(change);
    if (change !== null) parts.show(change);
    for (let id = core.takeReleased(); id !== 0; id = core.takeReleased()) parts.release(id);
    return change === null;
  }

  /** Reports the state as of `at`. Returns milliseconds: once they have passed, it is due. */
  private report(at: number): number {
    const core = this.core!;
    for (const { kind, message } of core.problems()) {
      if (kind === "replaced") throw new ReadError(message, false, "network");
      this.post({ type: "problem", kind, message }, []);
    }
    const state = this.state();
    if (state.buffered.some(([begin, end]) => begin <= state.seconds && state.seconds < end)) this.marks.mark("ready");
    const now = performance.now();
    const early = REPORT_INTERVAL - (now - this.reportedAt);
    if (state.state === this.lastState && early > 0) return early;
    this.lastState = state.state;
    this.reportedAt = now;
    this.post({
      type: "state", state: state.state, seconds: state.seconds, seek: this.lastSeek, at: performance.timeOrigin + at, rate: this.rate,
      buffered: state.buffered, layers: state.layers, layerCount: state.layerCount,
      bytes: state.bytes, bytesPerSecond: state.bytesPerSecond, memory: state.memory, duration: state.duration,
      live: state.live, tierPrimitives: state.tierPrimitives,
    }, []);
    return Infinity;
  }

  /** Returns the state of the core, and passes the size of its stable bytes to the reader. */
  private state(): CoreState {
    const state = this.core!.state();
    this.reader!.setStable(state.live?.stable ?? Infinity);
    return state;
  }

  private fail(error: unknown): void {
    this.close();
    this.post({ type: "error", code: codeOf(error), message: decoderProblem(error) }, []);
  }

  private close(): void {
    this.closed.abort();
    clearTimeout(this.timer);
    for (const controller of this.reads.values()) controller.abort();
    this.reads.clear();
    this.pool?.close();
    this.pool = null;
    this.parts = null;
    this.core = null; // with it, the memory of the module
  }
}

/** An error of the core; `code`: StatusCode of stgs/format/status.h. */
class CoreError extends Error {
  constructor(readonly code: number, message: string) {
    super(message);
  }
}

/** The number of decoding workers for this device. */
function decoders(): number {
  return Math.min(Math.max(navigator.hardwareConcurrency - 1, 1), MAX_DECODERS);
}

function closed(): ReadError {
  return new ReadError("the source was closed", false, "aborted");
}

/** Checks the options of a page. */
function checked(options: OpenMessage["options"]): OpenMessage["options"] {
  const { memoryBudget, maxPrimitives, lookAhead, latency } = options;
  const isTime = (seconds: number) => seconds >= 0 && seconds < Infinity;
  if (!(memoryBudget >= MIN_BUDGET && memoryBudget <= MAX_BUDGET && maxPrimitives >= 0 && isTime(lookAhead) && isTime(latency))) {
    throw new CoreError(USAGE, `memoryBudget ${memoryBudget}, maxPrimitives ${maxPrimitives}, lookAhead ${lookAhead} or latency ${latency} ` +
      `is out of range (expected ${MIN_BUDGET} to ${MAX_BUDGET} bytes, 0 or more, and 0 s or more)`);
  }
  return options;
}

type ErrorCode = Extract<CoreMessage, { type: "error" }>["code"];

function codeOf(error: unknown): ErrorCode {
  if (error instanceof ReadError) return error.code;
  if (isOutOfMemory(error)) return "memory";
  if (!(error instanceof CoreError)) return "unsupported";
  const names: Record<number, ErrorCode> = { 1: "usage", 2: "network", 3: "format", 8: "memory", 9: "memory" };
  return names[error.code] ?? "unsupported";
}

function sceneInfo(info: CoreInfo, url: string): SceneInfo {
  const { title, duration, tickSeconds, frames, shDegree, primitives, kernel, boundsMin, boundsMax, background, startCamera, tierPrimitives } = info;
  const up = info.up.some((v) => v !== 0) ? info.up : null;
  const metresPerUnit = info.metresPerUnit > 0 ? info.metresPerUnit : null;
  const floor = up !== null ? info.floor : null;
  const audio = info.audio !== "" ? { location: info.audio, begin: info.audioBegin, base: url } : null;
  return {
    title, duration, tickSeconds, frames, shDegree, primitives, kernel, boundsMin, boundsMax, up, metresPerUnit, floor, background, startCamera,
    tierPrimitives, audio,
  };
}

/** Repeats a read that may succeed later, with growing pauses. */
async function withRetry<T>(read: () => Promise<T>, signal: AbortSignal): Promise<T> {
  for (let attempt = 1; ; ++attempt) {
    try {
      return await read();
    } catch (error) {
      if (!(error instanceof ReadError) || !error.retry || attempt === OPEN_ATTEMPTS || signal.aborted) throw error;
      await pause(200 * 2 ** attempt, signal);
      if (signal.aborted) throw closed();
    }
  }
}

/** Waits, or ends early by an abort. */
function pause(milliseconds: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve) => {
    const end = () => {
      clearTimeout(timer);
      signal.removeEventListener("abort", end);
      resolve();
    };
    const timer = setTimeout(end, milliseconds);
    signal.addEventListener("abort", end);
  });
}
