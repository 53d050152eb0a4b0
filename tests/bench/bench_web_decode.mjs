// SPDX-License-Identifier: Apache-2.0
// Prints the rates at which the decoder of the web core decodes and packs all segments of a file, in
// node: the stages of one decoder, and one and two workers as the player runs them:
//   node tests/bench/bench_web_decode.mjs build/release/web/stgs/stgs-core.wasm scene.stgs [ROUNDS]
// Each segment is decoded once per round, with its SH. A stage counts with the least CPU time of each
// segment, and workers with their shortest round, because other programs may use the CPU.
import { readFileSync } from "node:fs";
import { isMainThread, parentPort, Worker } from "node:worker_threads";
import { jobsOfFile, primitivesOf } from "../web/decode_jobs.mjs";
import { importSource } from "../web/import_source.mjs";

const { decoderWorker, PartDecoder } = await importSource("src/core/part_decoder.ts");

const rate = (primitives, ms) => `${(primitives / ms / 1000).toFixed(2)} M/s`;

/** CPU time of this process, ms. */
function cpuTime() {
  const { user, system } = process.cpuUsage();
  return (user + system) / 1000;
}

/** Times the stages of a decoder on this thread. */
async function timeStages(open, jobs, rounds) {
  const decoder = await PartDecoder.open(open);
  const times = new Map(), best = jobs.map(() => new Map());
  const timed = (name, call) => (...args) => {
    const begin = cpuTime(), result = call(...args);
    times.set(name, (times.get(name) ?? 0) + cpuTime() - begin);
    return result;
  };
  const decode = timed("decode, pack and copy", decoder.decode.bind(decoder));
  let primitives = 0, first = 0;
  for (let round = 0; round < rounds; ++round) {
    const begin = cpuTime();
    primitives = 0;
    for (const [i, job] of jobs.entries()) {
      times.clear();
      const { status, parts } = decode(job);
      primitives += primitivesOf(status, parts);
      for (const [name, ms] of times) best[i].set(name, Math.min(best[i].get(name) ?? Infinity, ms));
    }
    if (round === 0) first = cpuTime() - begin;
  }
  const bytes = jobs.flatMap(({ records }) => records).reduce((sum, record) => sum + record.bytes.byteLength, 0);
  console.log(`${primitives} primitives in ${jobs.length} segments, ${(bytes / primitives).toFixed(1)} bytes each; ` +
    `memory ${(decoder.memoryBytes / 1e6).toFixed(1)} MB; first round ${rate(primitives, first)}`);
  for (const name of best[0].keys())
    console.log(`  ${name}: ${rate(primitives, best.reduce((sum, one) => sum + one.get(name), 0))}`);
}

/** Starts a worker of this script, with the interface of a browser's. */
function startThread() {
  const worker = new Worker(new URL(import.meta.url));
  const thread = { postMessage: (message, transfer) => worker.postMessage(message, transfer), terminate: () => worker.terminate() };
  worker.on("message", (data) => thread.onmessage?.({ data }));
  worker.on("error", (error) => thread.onerror?.(error));
  return thread;
}

/** Times a pool of workers. */
async function timePool(open, jobs, rounds, count) {
  const { DecoderPool } = await importSource("src/core/decoder_pool.ts");
  let best = Infinity, primitives = 0;
  const run = { received: () => undefined, failed: () => undefined };
  const pool = new DecoderPool(count, startThread, {
    decoded: (_id, status, parts) => run.received(primitivesOf(status, parts)),
    decodersFailed: (message) => run.failed(new Error(message)),
  });
  pool.open(open.module, open.name, open.fileBytes, open.maxMemory, open.pieces);
  for (let round = 0; round < rounds; ++round) {
    const queue = jobs.map((job) => ({ ...job, records: job.records.map(({ offset, bytes }) => ({ offset, bytes: bytes.slice(0) })) }));
    let left = queue.length;
    primitives = 0;
    const begin = performance.now();
    await new Promise((resolve, reject) => {
      run.failed = reject;
      run.received = (decoded) => {
        primitives += decoded;
        if (queue.length > 0) pool.decode(queue.shift());
        if (--left === 0) resolve();
      };
      for (const job of queue.splice(0, pool.capacity)) pool.decode(job);
    });
    best = Math.min(best, performance.now() - begin);
  }
  pool.close();
  console.log(`${count} ${count === 1 ? "worker" : "workers"}: ${rate(primitives, best)}`);
  return best;
}

if (isMainThread) {
  const [, , wasm, path, rounds = "9"] = process.argv;
  const file = readFileSync(path), module = await WebAssembly.compile(readFileSync(wasm));
  const { jobs, pieces } = await jobsOfFile(module, path, file);
  const open = { module, name: path, fileBytes: file.length, maxMemory: 2 ** 31, pieces };
  await timeStages(open, jobs, Number(rounds));
  const one = await timePool(open, jobs, Number(rounds), 1), two = await timePool(open, jobs, Number(rounds), 2);
  console.log(`two workers over one: ${(one / two).toFixed(2)}`);
} else {
  const handle = decoderWorker((reply, transfer) => parentPort.postMessage(reply, transfer));
  parentPort.on("message", handle);
}
