// SPDX-License-Identifier: Apache-2.0
// The first read of a source, and checks that later reads have the same version.
import assert from "node:assert/strict";
import test from "node:test";
import { importSource } from "./import_source.mjs";

const { rangeReader } = await importSource("src/core/range_reader.ts");
const { signal } = new AbortController();
const URL = "http://host/scene.stgs";

/** A server of `size` bytes; `change` changes the answer, an object with `begin`, `end`, `size`, `etag`. */
function serve(size, change = (answer) => answer) {
  const requests = [];
  globalThis.fetch = async (url, { headers }) => {
    requests.push(headers.Range);
    const [begin, last] = /^bytes=(\d+)-(\d+)$/.exec(headers.Range).slice(1).map(Number);
    const answer = change({ begin, end: Math.min(last, size - 1), size, etag: '"a"' });
    const body = Uint8Array.from({ length: answer.end - answer.begin + 1 }, (_, i) => (answer.begin + i) % 251);
    return new Response(body, {
      status: 206,
      headers: { "Content-Range": `bytes ${answer.begin}-${answer.end}/${answer.size}`, ETag: answer.etag },
    });
  };
  return requests;
}

test("one request reads the start of a file and its size", async () => {
  const requests = serve(1000);
  const { head, size, version } = await rangeReader(URL).readStart(100, signal);
  assert.deepEqual([head.length, head[7], size, version, requests], [100, 7, 1000, '"a"', ["bytes=0-99"]]);
});

test("a file may be shorter than the first read, a range of it may not", async () => {
  serve(30);
  const reader = rangeReader(URL);
  const { head, size } = await reader.readStart(100, signal);
  assert.deepEqual([head.length, head.buffer.byteLength, size], [30, 30, 30]);
  await assert.rejects(reader.read(20, new Uint8Array(20), signal), /shorter than before/);
});

test("an incomplete start is rejected", async () => {
  serve(1000, (answer) => ({ ...answer, end: answer.end - 1 }));
  await assert.rejects(rangeReader(URL).readStart(100, signal), { retry: true, message: /another range/ });
  serve(1000, (answer) => ({ ...answer, begin: 1 }));
  await assert.rejects(rangeReader(URL).readStart(100, signal), /another range/);
});

test("a file that is replaced after its start was read is detected", async () => {
  serve(1000);
  const known = await rangeReader(URL).readStart(100, signal); // by the page
  await rangeReader(URL, known).read(100, new Uint8Array(10), signal);
  serve(1000, (answer) => ({ ...answer, etag: '"b"' }));
  await assert.rejects(rangeReader(URL, known).read(100, new Uint8Array(10), signal), /was replaced/);
});

test("the start of a Blob can be read", async () => {
  const blob = new Blob([Uint8Array.of(1, 2, 3)]);
  const { head, size } = await rangeReader(blob).readStart(100, signal);
  assert.deepEqual([[...head], size], [[1, 2, 3], 3]);
});

test("a worker that is terminated ends the read that the page does for it", async () => {
  const { createWorker } = await importSource("src/resources.ts");
  let ended = 0;
  globalThis.Worker = class {
    postMessage() {}
    terminate() {
      ++ended;
    }
  };
  const signals = [];
  globalThis.fetch = (url, options) => {
    if (String(url) === URL) signals.push(options.signal);
    return new Promise((_, reject) => options?.signal.addEventListener("abort", () => reject(new Error("aborted"))));
  };
  const worker = createWorker(URL);
  assert.deepEqual(signals.map(({ aborted }) => aborted), [false]);
  worker.terminate();
  assert.deepEqual([signals[0].aborted, ended], [true, 1]);
});
