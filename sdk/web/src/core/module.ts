// SPDX-License-Identifier: Apache-2.0
// The player of the WASM core (sdk/web/core/exports.cpp), one per instance.
import type { LiveState, OpenOptions, ProblemKind } from "../types";
import { Instance } from "./instance";

/** The functions of the host that the player calls. Addresses are in the memory of the module. */
export interface CoreHost {
  /** Begins to read bytes of the file to `address`; `Core.readDone()` ends it. */
  read(id: number, offset: number, bytes: number, address: number): void;
  /** Ends a read early, also by `Core.readDone()`. */
  cancel(id: number): void;
  /** Begins to decode a segment from copies of its records; `Core.decodeDone()` ends it. */
  decode(job: DecodeJob): void;
}

/** Bytes of the file from an offset on. */
export interface FilePiece {
  offset: number;
  bytes: ArrayBuffer;
}

/** A segment to decode: `segment` is a message of the core, of write_job(). */
export interface DecodeJob {
  id: number;
  segment: ArrayBuffer;
  withSh: boolean;
  records: FilePiece[];
}

/** The result of decoding a segment: the origin of its times, in ticks, and the failures. */
export interface DecodeStatus {
  origin: number;
  base: CoreStatus;
  sh: CoreStatus;
}

/** `code`: StatusCode of stgs/format/status.h. */
export interface CoreStatus {
  code: number;
  message: string;
}

interface Exports {
  stgs_create(name: number, bytes: number, follows: number, latency: number, memoryBudget: number, maxPrimitives: number,
              prefetch: number, decodes: number): void;
  stgs_open(): number;
  stgs_provide(offset: number, bytes: number): number;
  stgs_play(): void;
  stgs_pause(): void;
  stgs_seek(seconds: number): number;
  stgs_set_rate(rate: number): number;
  stgs_set_latency(seconds: number): number;
  stgs_set_loop(loop: number): void;
  stgs_limit_primitives(maxPrimitives: number): void;
  stgs_step(now: number, budget: number): number;
  stgs_read_done(id: number, failure: number, fileBytes: number, now: number): void;
  stgs_decode_done(id: number, origin: number, baseCode: number, base: number, shCode: number, sh: number): void;
  stgs_take_released(): number;
  stgs_state(): number;
  stgs_events(): number;
  stgs_next_change(): number;
  stgs_change_segment(): number;
  stgs_change_decoded(): number;
  stgs_change_begin(): number;
  stgs_change_end(): number;
  stgs_change_origin(): number;
}

/** An instance of the module with a player. */
export class Core {
  private constructor(private readonly instance: Instance<Exports>) {}

  /** Instantiates a compiled module. */
  static async create(module: WebAssembly.Module, host: CoreHost): Promise<Core> {
    let own: Instance<Exports> | undefined;
    const piece = (offset: number, address: number, bytes: number) => ({ offset, bytes: own!.copy(address, bytes) });
    own = await Instance.create<Exports>(module, {
      stgs_host_read: (id, offset, bytes, address) => host.read(id >>> 0, offset, bytes >>> 0, address >>> 0),
      stgs_host_cancel: (id) => host.cancel(id >>> 0),
      stgs_host_decode: (id, segment, segmentBytes, withSh, offset, base, bytes, shOffset, sh, shBytes) => {
        const records = [piece(offset, base, bytes >>> 0)];
        if (shBytes !== 0) records.push(piece(shOffset, sh, shBytes >>> 0));
        host.decode({ id: id >>> 0, segment: own!.copy(segment, segmentBytes), withSh: withSh !== 0, records });
      },
    });
    return new Core(own);
  }

  /** The module's memory from `address` on. Valid until the next call of the core. */
  bytes(address: number, length: number): Uint8Array {
    return this.instance.bytes(address, length);
  }

  /**
   * Starts to open a file of `fileBytes` bytes. `follows`: whether it may grow; `decodes`: segments that the
   * host decodes at a time.
   */
  open(name: string, fileBytes: number, follows: boolean, options: OpenOptions, decodes: number): void {
    const { memoryBudget, maxPrimitives, lookAhead, latency } = options;
    this.instance.withTexts([name], (address) =>
      this.instance.exports.stgs_create(address, fileBytes, follows ? 1 : 0, latency, memoryBudget, counted(maxPrimitives),
        lookAhead, decodes));
  }

  /** Tries to open the file: its description, the bytes that it needs first, or why it failed. */
  tryOpen(): OpenResult {
    return JSON.parse(this.instance.text(this.instance.exports.stgs_open())) as OpenResult;
  }

  /** Provides bytes of the file for the next tryOpen(). */
  provide(offset: number, bytes: Uint8Array): void {
    const address = this.instance.exports.stgs_provide(offset, bytes.length);
    this.bytes(address, bytes.length).set(bytes);
  }

  play(): void {
    this.instance.exports.stgs_play();
  }
  pause(): void {
    this.instance.exports.stgs_pause();
  }
  /** Returns whether the time is valid. */
  seek(seconds: number): boolean {
    return this.instance.exports.stgs_seek(seconds) !== 0;
  }
  /** Returns whether the rate is valid. */
  setRate(rate: number): boolean {
    return this.instance.exports.stgs_set_rate(rate) !== 0;
  }
  /** Sets `OpenOptions.latency`. Returns whether it is valid. */
  setLatency(seconds: number): boolean {
    return this.instance.exports.stgs_set_latency(seconds) !== 0;
  }
  setLoop(loop: boolean): void {
    this.instance.exports.stgs_set_loop(loop ? 1 : 0);
  }
  /** Limits the tiers to those that have at most this many primitives in total at any time; at least one is shown. */
  limitPrimitives(maxPrimitives: number): void {
    this.instance.exports.stgs_limit_primitives(counted(maxPrimitives));
  }

  /** Plays, and begins reads and decodings, for about `budget` seconds; returns the seconds until the next call is due. */
  step(budget: number): number {
    return this.instance.exports.stgs_step(performance.now() / 1000, budget);
  }

  /** Ends a read; `failure`: why it failed, or ""; `fileBytes`: size of the file. */
  readDone(id: number, failure: string, fileBytes: number): void {
    this.instance.withTexts([failure], (address) =>
      this.instance.exports.stgs_read_done(id, address, fileBytes, performance.now() / 1000));
  }

  /** Ends a decoding. */
  decodeDone(id: number, { origin, base, sh }: DecodeStatus): void {
    this.instance.withTexts([base.message, sh.message], (baseMessage, shMessage) =>
      this.instance.exports.stgs_decode_done(id, origin, base.code, baseMessage, sh.code, shMessage));
  }

  /** The id of a decoding whose result is no longer needed, once; 0: there is none. */
  takeReleased(): number {
    return this.instance.exports.stgs_take_released() >>> 0;
  }

  state(): CoreState {
    return JSON.parse(this.instance.text(this.instance.exports.stgs_state())) as CoreState;
  }

  /** The problems since the last call. The other events of the core have no message; the state contains them. */
  problems(): CoreProblem[] {
    const events = JSON.parse(this.instance.text(this.instance.exports.stgs_events())) as { message: string }[];
    return events.filter(({ message }) => message !== "") as CoreProblem[];
  }

  /** The next segment to show or to drop; null: there is none. */
  nextChange(): SegmentChange | null {
    const e = this.instance.exports;
    if (e.stgs_next_change() === 0) return null;
    return {
      segment: e.stgs_change_segment() >>> 0,
      decoded: e.stgs_change_decoded() >>> 0,
      begin: e.stgs_change_begin(),
      end: e.stgs_change_end(),
      origin: e.stgs_change_origin(),
    };
  }
}

/** A number of primitives, 0 or more, as the core takes it. */
function counted(primitives: number): number {
  return Math.min(primitives, Number.MAX_SAFE_INTEGER);
}

/** The description of a scene, as types.ts. */
export interface CoreInfo {
  duration: number;
  tickSeconds: number;
  frames: number;
  shDegree: number;
  primitives: number;
  kernel: number;
  boundsMin: number[];
  boundsMax: number[];
  background: number[];
  up: number[];
  metresPerUnit: number;  // 0: unknown
  floor: number[];        // valid if `up` is known
  title: string;
  tierPrimitives: number[];
  audio: string;       // "": none
  audioBegin: number;  // seconds
  startCamera: null | {
    rotation: number[]; translation: number[];
    fx: number; fy: number; cx: number; cy: number; width: number; height: number; near: number;
  };
}
export type OpenResult = { info: CoreInfo } | { missing: [number, number] } | CoreStatus;
export interface CoreState {
  state: "playing" | "paused" | "buffering" | "ended";
  seconds: number;
  duration: number;
  /** Of a growing recording. `stable`: bytes that the file keeps. */
  live: (LiveState & { stable: number }) | null;
  buffered: [number, number][];
  layers: number;
  layerCount: number;
  tierPrimitives: number[]; // as far as known now
  bytes: number;
  memory: number;
  bytesPerSecond: number;
}
/** `replaced`: the server now has another file, which ends playback. */
export interface CoreProblem {
  kind: ProblemKind | "replaced";
  message: string;
}
/** `decoded`: the id of its decoding, or 0: the segment is no longer needed. Times are ticks, as PackedSegment. */
export interface SegmentChange {
  segment: number;
  decoded: number;
  begin: number;
  end: number;
  origin: number;
}
