// SPDX-License-Identifier: Apache-2.0
// An instance of the WASM module: its memory, texts, and the functions of the system that it calls.

/** The module needs more memory than the browser gives it. */
export class OutOfMemory extends Error {}

/** Whether an error means that memory was lacking. C++ exceptions that leave the module, such as std::bad_alloc, are no Errors. */
export function isOutOfMemory(error: unknown): boolean {
  return error instanceof OutOfMemory || error instanceof RangeError || !(error instanceof Error);
}

/** The message, for display, of an error that a function of the core has thrown. */
export function decoderProblem(error: unknown): string {
  if (error instanceof WebAssembly.RuntimeError) return `the decoder stopped (${error.message}); report the file`;
  return error instanceof Error ? error.message : "the decoder is out of memory; lower the memory budget";
}

/** The functions of the host that the core calls (sdk/web/core/page.h). */
export interface HostImports {
  stgs_host_read(id: number, offset: number, bytes: number, address: number): void;
  stgs_host_cancel(id: number): void;
  stgs_host_decode(id: number, segment: number, segmentBytes: number, withSh: number, offset: number, base: number,
                   bytes: number, shOffset: number, sh: number, shBytes: number): void;
  stgs_host_part(first: number, count: number, bytes: number): void;
  stgs_host_fill(offset: number, from: number, bytes: number): void;
}

const unused = () => undefined;
const UNUSED: HostImports = {
  stgs_host_read: unused, stgs_host_cancel: unused, stgs_host_decode: unused, stgs_host_part: unused, stgs_host_fill: unused,
};

interface MemoryExports {
  memory: WebAssembly.Memory;
  _initialize(): void;
  stgs_allocate(bytes: number): number;
  stgs_free(address: number): void;
}

/** An instance with the exported functions `Exports`. */
export class Instance<Exports> {
  private constructor(private readonly base: MemoryExports, readonly exports: Exports) {}

  /** Instantiates a compiled module. `host`: the functions that it calls in this use. */
  static async create<Exports>(module: WebAssembly.Module, host: Partial<HostImports>): Promise<Instance<Exports>> {
    const env = { ...UNUSED, ...host, emscripten_notify_memory_growth: () => undefined };
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
    const base = instance.exports as unknown as MemoryExports;
    memory = base.memory;
    base._initialize();
    return new Instance<Exports>(base, instance.exports as unknown as Exports);
  }

  /** The memory from `address` on. Valid until the next call of an exported function. */
  bytes(address: number, length: number): Uint8Array {
    return new Uint8Array(this.base.memory.buffer, address >>> 0, length);
  }

  /** A copy of the memory from `address` on. */
  copy(address: number, length: number): ArrayBuffer {
    return this.base.memory.buffer.slice(address >>> 0, (address >>> 0) + length);
  }

  /** Bytes of the memory. */
  get memoryBytes(): number {
    return this.base.memory.buffer.byteLength;
  }

  /** Reads a text that ends with a zero byte. */
  text(address: number): string {
    const all = new Uint8Array(this.base.memory.buffer, address >>> 0);
    return new TextDecoder().decode(all.subarray(0, all.indexOf(0)));
  }

  /** Calls a function with the addresses of texts, which are valid during the call. */
  withTexts(values: string[], call: (...addresses: number[]) => void): void {
    const addresses = values.map((value) => this.place(value));
    call(...addresses);
    for (const address of addresses) this.base.stgs_free(address);
  }

  private place(value: string): number {
    const bytes = new TextEncoder().encode(value);
    const address = this.base.stgs_allocate(bytes.length + 1) >>> 0;
    if (address === 0) throw new OutOfMemory("the decoder has no memory; lower the memory budget");
    const to = this.bytes(address, bytes.length + 1);
    to.set(bytes);
    to[bytes.length] = 0;
    return address;
  }
}
