// SPDX-License-Identifier: Apache-2.0
// The WASM core: the C++ of sdk/web/core, one player per instance.

/** The functions of the host that the core calls. Addresses are in the memory of the module. */
export interface CoreHost {
  /** Begins to read bytes of the file to `address`; `Core.readDone()` ends it. */
  read(id: number, offset: number, bytes: number, address: number): void;
  /** Ends a read early, also by `Core.readDone()`. */
  cancel(id: number): void;
}

interface Exports {
  memory: WebAssembly.Memory;
  _initialize(): void;
  stgs_allocate(bytes: number): number;
  stgs_free(address: number): void;
  stgs_create(name: number, bytes: number, memoryBudget: number, prefetch: number): void;
  stgs_destroy(): void;
  stgs_open(): number;
  stgs_provide(offset: number, bytes: number): number;
  stgs_play(): void;
  stgs_pause(): void;
  stgs_seek(seconds: number): number;
  stgs_set_rate(rate: number): number;
  stgs_set_loop(loop: number): void;
  stgs_step(now: number, budget: number): number;
  stgs_read_done(id: number, failure: number, now: number): void;
  stgs_state(): number;
  stgs_events(): number;
  stgs_next_change(): number;
  stgs_change_id(): number;
  stgs_change_primitives(): number;
  stgs_change_begin(): number;
  stgs_change_end(): number;
  stgs_change_origin(): number;
  stgs_change_bytes(): number;
  stgs_change_packed(): number;
}

/** The module needs more memory than the browser gives it. */
export class OutOfMemory extends Error {}

/** An instance of the module. */
export class Core {
  private constructor(private readonly exports: Exports) {}

  /** Instantiates a compiled module. */
  static async create(module: WebAssembly.Module, host: CoreHost): Promise<Core> {
    const env = {
      stgs_host_read: (id: number, offset: number, bytes: number, address: number) =>
        host.read(id >>> 0, offset, bytes >>> 0, address >>> 0),
      stgs_host_cancel: (id: number) => host.cancel(id >>> 0),
      emscripten_notify_memory_growth: () => undefined,
    };
    let memory: WebAssembly.Memory | undefined;
    const system = {
      // Writes nanoseconds of a monotonic clock.
      clock_time_get: (_clock: number, _precision: bigint, address: number) => {
        const now = BigInt(Math.round(performance.now() * 1e6));
        new DataView(memory!.buffer).setBigUint64(address >>> 0, now, true);
        return 0;
      },
      proc_exit: (code: number) => {
        throw new OutOfMemory(`the decoder stopped (code ${code}); close other pages or lower the memory budget`);
      },
      environ_sizes_get: (count: number, bytes: number) => {
        const view = new DataView(memory!.buffer);
        view.setUint32(count >>> 0, 0, true);
        view.setUint32(bytes >>> 0, 0, true);
        return 0;
      },
      environ_get: () => 0,
    };
    const instance = await WebAssembly.instantiate(module, { env, wasi_snapshot_preview1: system });
    const exports = instance.exports as unknown as Exports;
    memory = exports.memory;
    exports._initialize();
    return new Core(exports);
  }

  /** The module's memory from `address` on. Valid until the next call of the core. */
  bytes(address: number, length: number): Uint8Array {
    return new Uint8Array(this.exports.memory.buffer, address, length);
  }

  /** Bytes of the module's memory. */
  get memoryBytes(): number {
    return this.exports.memory.buffer.byteLength;
  }

  /** Begins a file. Sizes are bytes; `prefetch`: seconds to fetch ahead. */
  open(name: string, fileBytes: number, memoryBudget: number, prefetch: number): void {
    this.withText(name, (address) => this.exports.stgs_create(address, fileBytes, memoryBudget, prefetch));
  }

  /** Tries to open the file: its description, the bytes that it needs first, or why it failed. */
  tryOpen(): OpenResult {
    return JSON.parse(this.text(this.exports.stgs_open())) as OpenResult;
  }

  /** Provides bytes of the file for the next tryOpen(). */
  provide(offset: number, bytes: Uint8Array): void {
    const address = this.exports.stgs_provide(offset, bytes.length) >>> 0;
    this.bytes(address, bytes.length).set(bytes);
  }

  play(): void {
    this.exports.stgs_play();
  }
  pause(): void {
    this.exports.stgs_pause();
  }
  /** Returns whether the time is valid. */
  seek(seconds: number): boolean {
    return this.exports.stgs_seek(seconds) !== 0;
  }
  /** Returns whether the rate is valid. */
  setRate(rate: number): boolean {
    return this.exports.stgs_set_rate(rate) !== 0;
  }
  setLoop(loop: boolean): void {
    this.exports.stgs_set_loop(loop ? 1 : 0);
  }

  /** Plays and decodes for about `budget` seconds; returns the seconds until the next call is due. */
  step(budget: number): number {
    return this.exports.stgs_step(performance.now() / 1000, budget);
  }

  /** Ends a read; `failure`: why it failed, or "". */
  readDone(id: number, failure: string): void {
    this.withText(failure, (address) => this.exports.stgs_read_done(id, address, performance.now() / 1000));
  }

  state(): CoreState {
    return JSON.parse(this.text(this.exports.stgs_state())) as CoreState;
  }

  /** The events since the last call. */
  events(): CoreEvent[] {
    return JSON.parse(this.text(this.exports.stgs_events())) as CoreEvent[];
  }

  /** The next part of a segment to hold or to drop (0 primitives); null: there is none. */
  nextChange(): SegmentChange | null {
    const e = this.exports;
    if (e.stgs_next_change() === 0) return null;
    const primitives = e.stgs_change_primitives() >>> 0;
    const length = e.stgs_change_bytes() >>> 0;
    const words = new Uint8Array(length);
    words.set(this.bytes(e.stgs_change_packed() >>> 0, length));
    return {
      id: e.stgs_change_id() >>> 0,
      primitives,
      begin: e.stgs_change_begin(),
      end: e.stgs_change_end(),
      origin: e.stgs_change_origin(),
      words: words.buffer,
    };
  }

  /** Ends the player. Reads that have not ended must not be written any more. */
  destroy(): void {
    this.exports.stgs_destroy();
  }

  private text(address: number): string {
    const all = new Uint8Array(this.exports.memory.buffer, address >>> 0);
    return new TextDecoder().decode(all.subarray(0, all.indexOf(0)));
  }

  private withText(value: string, call: (address: number) => void): void {
    const bytes = new TextEncoder().encode(value);
    const address = this.exports.stgs_allocate(bytes.length + 1) >>> 0;
    if (address === 0) throw new OutOfMemory("the decoder has no memory; lower the memory budget");
    const to = this.bytes(address, bytes.length + 1);
    to.set(bytes);
    to[bytes.length] = 0;
    call(address);
    this.exports.stgs_free(address);
  }
}

/** The description of a scene, as types.ts. */
export interface CoreInfo {
  duration: number;
  tickSeconds: number;
  frames: number;
  shDegree: number;
  primitives: number;
  boundsMin: number[];
  boundsMax: number[];
  background: number[];
  up: number[];
  title: string;
  startCamera: null | {
    rotation: number[]; translation: number[];
    fx: number; fy: number; cx: number; cy: number; width: number; height: number; near: number;
  };
}
export type OpenResult = { info: CoreInfo } | { missing: [number, number] } | { code: number; message: string };
export interface CoreState {
  state: "playing" | "paused" | "buffering" | "ended";
  seconds: number;
  buffered: [number, number][];
  layers: number;
  layerCount: number;
  bytes: number;
  memory: number;
}
export interface CoreEvent {
  kind: string;
  seconds: number;
  message: string;
}
export interface SegmentChange {
  id: number;
  primitives: number;
  begin: number;
  end: number;
  origin: number;
  words: ArrayBuffer;
}
