// SPDX-License-Identifier: Apache-2.0
// A decoder of the WASM core (sdk/web/core/exports_decoder.cpp), one per instance, and the worker
// that runs it.
import { decoderProblem, Instance, isOutOfMemory } from "./instance";
import type { CoreStatus, DecodeJob, DecodeStatus, FilePiece } from "./module";

/** Consecutive primitives of a segment, packed for the GPU. */
export interface Part {
  primitives: number;
  words: ArrayBuffer;
}

/** Messages to a decoding worker. `pieces`: all bytes with which the file was opened. */
export type DecoderRequest =
  | { type: "open"; module: WebAssembly.Module; name: string; fileBytes: number; maxMemory: number; pieces: FilePiece[] }
  | { type: "decode"; job: DecodeJob };

/** Its answers, one per job. `failure`: the worker has stopped; `outOfMemory`: because of it. */
export type DecoderReply =
  | { type: "decoded"; id: number; status: DecodeStatus; parts: Part[] }
  | { type: "failed"; failure: string; outOfMemory: boolean };

interface Exports {
  stgs_decoder_create(name: number, bytes: number, maxMemory: number): void;
  stgs_decoder_provide(offset: number, bytes: number): number;
  stgs_decoder_open(): number;
  stgs_decoder_segment(): number;
  stgs_decoder_decode(withSh: number): number;
  stgs_decoder_next(): number;
  stgs_decoder_bytes(): number;
  stgs_decoder_packed(): number;
}

const unused = () => undefined;

/** Decodes segments of one file. */
export class PartDecoder {
  private constructor(private readonly instance: Instance<Exports>) {}

  /** Opens a file. Rejects with a message if that fails. */
  static async open(request: Extract<DecoderRequest, { type: "open" }>): Promise<PartDecoder> {
    const host = { stgs_host_read: unused, stgs_host_cancel: unused, stgs_host_decode: unused };
    const own = new PartDecoder(await Instance.create<Exports>(request.module, host));
    const { instance } = own;
    instance.withTexts([request.name], (name) =>
      instance.exports.stgs_decoder_create(name, request.fileBytes, request.maxMemory));
    own.provide(request.pieces);
    const status = JSON.parse(instance.text(instance.exports.stgs_decoder_open())) as CoreStatus;
    if (status.code !== 0) throw new Error(status.message);
    return own;
  }

  /** Decodes a segment. Without parts if `status.base` is an error. */
  decode(job: DecodeJob): { status: DecodeStatus; parts: Part[] } {
    const e = this.instance.exports;
    this.provide(job.records);
    this.instance.bytes(e.stgs_decoder_segment(), job.segment.byteLength).set(new Uint8Array(job.segment));
    const status = JSON.parse(this.instance.text(e.stgs_decoder_decode(job.withSh ? 1 : 0))) as DecodeStatus;
    const parts: Part[] = [];
    for (let primitives = e.stgs_decoder_next() >>> 0; primitives !== 0; primitives = e.stgs_decoder_next() >>> 0) {
      const words = this.instance.copy(e.stgs_decoder_packed(), e.stgs_decoder_bytes() >>> 0);
      parts.push({ primitives, words });
    }
    return { status, parts };
  }

  /** Bytes of the module's memory. */
  get memoryBytes(): number {
    return this.instance.memoryBytes;
  }

  private provide(pieces: FilePiece[]): void {
    for (const { offset, bytes } of pieces) {
      const address = this.instance.exports.stgs_decoder_provide(offset, bytes.byteLength);
      this.instance.bytes(address, bytes.byteLength).set(new Uint8Array(bytes));
    }
  }
}

/** Returns the handler of a decoding worker's messages, which answers by `post`. */
export function decoderWorker(post: (reply: DecoderReply, transfer: Transferable[]) => void): (request: DecoderRequest) => void {
  let last: Promise<unknown> = Promise.resolve(); // one request after the other
  let decoder: PartDecoder | null = null;
  const handle = async (request: DecoderRequest) => {
    if (request.type === "open") {
      decoder = null;
      decoder = await PartDecoder.open(request);
      return;
    }
    if (decoder === null) return; // it has failed
    const { status, parts } = decoder.decode(request.job);
    post({ type: "decoded", id: request.job.id, status, parts }, parts.map((part) => part.words));
  };
  return (request) => {
    last = last.then(() => handle(request)).catch((error: unknown) => {
      decoder = null;
      post({ type: "failed", failure: decoderProblem(error), outOfMemory: isOutOfMemory(error) }, []);
    });
  };
}
