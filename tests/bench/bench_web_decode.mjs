// SPDX-License-Identifier: Apache-2.0
// Prints the rate at which the decoder of the web core decodes and packs the segments of a file, in
// node, on one thread:
//   node tests/bench/bench_web_decode.mjs build/release/web/stgs/stgs-core.wasm scene.stgs [ROUNDS]
import { readFileSync } from "node:fs";
import { importSource } from "../web/import_source.mjs";

const [, , wasm, path, rounds = "5"] = process.argv;
const { Core } = await importSource("src/core/module.ts");
const { PartDecoder } = await importSource("src/core/part_decoder.ts");
const file = readFileSync(path);
const module = await WebAssembly.compile(readFileSync(wasm));
const slice = (offset, bytes) => file.buffer.slice(file.byteOffset + offset, file.byteOffset + offset + bytes);

/** Returns the jobs of playing the whole file, and the bytes with which it is opened. */
async function jobsOfFile() {
  const jobs = [], pieces = [], reads = [];
  const host = { read: (...read) => reads.push(read), cancel: () => undefined, decode: (job) => jobs.push(job) };
  const core = await Core.create(module, host);
  core.open(path, file.length, 2 ** 31, 1e6, 2 ** 20);
  for (let result = core.tryOpen(); !("info" in result); result = core.tryOpen()) {
    if (!("missing" in result)) throw new Error(result.message);
    const [offset, bytes] = result.missing;
    pieces.push({ offset, bytes: slice(offset, bytes) });
    core.provide(offset, new Uint8Array(slice(offset, bytes)));
  }
  for (;;) {
    core.step(10);
    if (reads.length === 0) return { jobs, pieces };
    for (const [id, offset, bytes, address] of reads.splice(0)) {
      core.bytes(address, bytes).set(new Uint8Array(slice(offset, bytes)));
      core.readDone(id, "");
    }
  }
}

const { jobs, pieces } = await jobsOfFile();
const decoder = await PartDecoder.open({ module, name: path, fileBytes: file.length, maxMemory: 2 ** 31, pieces });
for (let round = 0; round < Number(rounds); ++round) {
  const begin = process.cpuUsage();
  let primitives = 0;
  for (const job of jobs) {
    const { status, parts } = decoder.decode(job);
    if (status.base.code !== 0) throw new Error(status.base.message);
    for (const part of parts) primitives += part.primitives;
  }
  const { user, system } = process.cpuUsage(begin);
  const ms = (user + system) / 1000;
  console.log(`${primitives} primitives, ${jobs.length} jobs: ${ms.toFixed(1)} ms of CPU time, ${(primitives / ms / 1000).toFixed(2)} M/s, ` +
    `${(decoder.memoryBytes / 1e6).toFixed(1)} MB`);
}
