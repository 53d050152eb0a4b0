// SPDX-License-Identifier: Apache-2.0
// Workers that decode segments of a file.
import type { DecodeJob, DecodeStatus, FilePiece } from "./module";
import type { DecoderReply, DecoderRequest, Part } from "./part_decoder";

/** The part of Worker that is used. */
export interface DecoderThread {
  onmessage: ((event: MessageEvent<DecoderReply>) => void) | null;
  onerror: ((event: ErrorEvent) => void) | null;
  onmessageerror: ((event: MessageEvent) => void) | null;
  postMessage(request: DecoderRequest, transfer: Transferable[]): void;
  terminate(): void;
}

/** Receives the results of a pool. */
export interface DecoderPoolOwner {
  decoded(id: number, status: DecodeStatus, parts: Part[]): void;
  /** A worker has stopped: nothing more is decoded. */
  decodersFailed(message: string, outOfMemory: boolean): void;
}

/** Segments that wait at a worker while it decodes another one, so that it never waits for the next. */
const QUEUED = 1;

/** The workers of one file. */
export class DecoderPool {
  /** Jobs that may be in flight. */
  readonly capacity: number;
  private readonly threads: { thread: DecoderThread; jobs: number }[] = [];

  /** Starts `count` workers. */
  constructor(count: number, start: () => DecoderThread, private readonly owner: DecoderPoolOwner) {
    this.capacity = count * (1 + QUEUED);
    for (let i = 0; i < count; ++i) {
      const entry = { thread: start(), jobs: 0 };
      entry.thread.onmessage = ({ data }) => this.receive(entry, data);
      entry.thread.onerror = (event) => this.fail(`a decoding worker stopped (${event.message ?? "it could not be started"})`, false);
      entry.thread.onmessageerror = () => this.fail("a decoding worker received an unreadable message", false);
      this.threads.push(entry);
    }
  }

  /** Opens the file, by copies of all bytes with which it was opened. */
  open(module: WebAssembly.Module, name: string, fileBytes: number, maxMemory: number, pieces: FilePiece[]): void {
    for (const { thread } of this.threads)
      thread.postMessage({ type: "open", module, name, fileBytes, maxMemory, pieces }, []);
  }

  /** Decodes a segment in the worker with the fewest jobs. Takes the ownership of the records. */
  decode(job: DecodeJob): void {
    const entry = this.threads.reduce((best, one) => (one.jobs < best.jobs ? one : best));
    ++entry.jobs;
    entry.thread.postMessage({ type: "decode", job }, job.records.map((record) => record.bytes));
  }

  /** Ends the workers. Nothing is received any more. */
  close(): void {
    for (const { thread } of this.threads) {
      thread.onmessage = null;
      thread.onerror = null;
      thread.onmessageerror = null;
      thread.terminate();
    }
    this.threads.length = 0;
  }

  private receive(entry: { jobs: number }, reply: DecoderReply): void {
    if (reply.type === "failed") return this.fail(reply.failure, reply.outOfMemory);
    --entry.jobs;
    this.owner.decoded(reply.id, reply.status, reply.parts);
  }

  private fail(message: string, outOfMemory: boolean): void {
    this.close();
    this.owner.decodersFailed(message, outOfMemory);
  }
}
