// SPDX-License-Identifier: Apache-2.0
// The jobs in which a player decodes a file.
import { importSource } from "./import_source.mjs";

/** Returns the last job of each segment of a file, and the bytes with which the file is opened. */
export async function jobsOfFile(module, path, file) {
  const { Core } = await importSource("src/core/module.ts");
  const jobs = new Map(), pieces = [], reads = [], ended = [];
  const slice = (offset, bytes) => file.buffer.slice(file.byteOffset + offset, file.byteOffset + offset + bytes);
  const decode = (job) => {
    jobs.set(job.records[0].offset, job);
    ended.push(job.id);
  };
  const core = await Core.create(module, { read: (...read) => reads.push(read), cancel: () => undefined, decode });
  const options = { memoryBudget: 2 ** 31, maxPrimitives: Infinity, lookAhead: 1e6, latency: 1 };
  core.open(path, file.length, false, options, 2 ** 20);
  for (let result = core.tryOpen(); !("info" in result); result = core.tryOpen()) {
    if (!("missing" in result)) throw new Error(result.message);
    const [offset, bytes] = result.missing;
    pieces.push({ offset, bytes: slice(offset, bytes) });
    core.provide(offset, new Uint8Array(slice(offset, bytes)));
  }
  for (;;) {
    core.step(10);
    if (reads.length + ended.length === 0) return { jobs: [...jobs.values()], pieces };
    for (const [id, offset, bytes, address] of reads.splice(0)) {
      core.bytes(address, bytes).set(new Uint8Array(slice(offset, bytes)));
      core.readDone(id, "", file.length);
    }
    const good = { code: 0, message: "" };
    for (const id of ended.splice(0)) core.decodeDone(id, { origin: 0, base: good, sh: good });
  }
}

/** The primitives of the parts of a job; throws if it fails. */
export function primitivesOf(status, parts) {
  for (const { code, message } of [status.base, status.sh]) if (code !== 0) throw new Error(message);
  return parts.reduce((sum, part) => sum + part.primitives, 0);
}
