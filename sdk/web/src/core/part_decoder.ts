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
  stgs_decoder_segment(bytes: number): number;
  stgs_decoder_decode(withSh: number): number;
}

/** Decodes segments of one file. */
export class PartDecoder {
  private parts: Part[] = []; // of the segment that is decoded
  private words = new Uint8Array(0); // of the last part

  private constructor(private readonly instance: Instance<Exports>) {}

  /** Opens a file. Rejects with a message if that fails. */
  static async open(request: Extract<DecoderRequest, { type: "open" }>): Promise<PartDecoder> {
    let own: PartDecoder | undefined;
    const instance = await Instance.create<Exports>(request.module, {
      stgs_host_part: (first, count, bytes) => own!.addPart(first >>> 0, count >>> 0, bytes >>> 0),
      stgs_host_fill: (offset, from, bytes) => own!.fillPart(offset >>> 0, from, bytes >>> 0),
    });
    own = new PartDecoder(instance);
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
    const segmentBytes = job.segment.byteLength;
    this.instance.bytes(e.stgs_decoder_segment(segmentBytes), segmentBytes).set(new Uint8Array(job.segment));
    const status = JSON.parse(this.instance.text(e.stgs_decoder_decode(job.withSh ? 1 : 0))) as DecodeStatus;
    const parts = status.base.code === 0 ? this.parts : [];
    this.parts = [];
    return { status, parts };
  }

  /** Bytes of the module's memory. */
  get memoryBytes(): number {
    return this.instance.memoryBytes;
  }

  private addPart(first: number, primitives: number, bytes: number): void {
    if (first === 0) this.parts = [];
    this.words = new Uint8Array(bytes);
    this.parts.push({ primitives, words: this.words.buffer as ArrayBuffer });
  }

  private fillPart(offset: number, from: number, bytes: number): void {
    this.words.set(this.instance.bytes(from, bytes), offset);
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
