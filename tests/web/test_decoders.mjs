// SPDX-License-Identifier: Apache-2.0
// The pool of decoding workers, with threads of its own making, and the parts on the page.
import assert from "node:assert/strict";
import test from "node:test";
import { importSource } from "./import_source.mjs";

const { DecoderPool } = await importSource("src/core/decoder_pool.ts");
const { ShownParts } = await importSource("src/core/shown_parts.ts");

const OK = { origin: 0, base: { code: 0, message: "" }, sh: { code: 0, message: "" } };

class FakeThread {
  onmessage = null;
  onerror = null;
  requests = [];
  ended = false;
  postMessage(request) {
    this.requests.push(request);
  }
  terminate() {
    this.ended = true;
  }
  reply(data) {
    this.onmessage?.({ data });
  }
}

/** A pool of fake threads, and the calls of its owner. */
function makePool(count) {
  const threads = [], results = [], failures = [];
  const owner = {
    decoded: (id, status, parts) => results.push({ id, status, parts }),
    decodersFailed: (message, outOfMemory) => failures.push({ message, outOfMemory }),
  };
  const start = () => threads[threads.push(new FakeThread()) - 1];
  return { pool: new DecoderPool(count, start, owner), threads, results, failures };
}

const job = (id) => ({ id, segment: new ArrayBuffer(8), withSh: false, records: [{ offset: 0, bytes: new ArrayBuffer(8) }] });
const jobsOf = (thread) => thread.requests.filter(({ type }) => type === "decode").map((request) => request.job.id);

test("every worker opens the file, and has room for a job that waits", () => {
  const { pool, threads } = makePool(3);
  const pieces = [{ offset: 0, bytes: new ArrayBuffer(4) }];
  pool.open({}, "a.stgs", 4, 1000, pieces);
  for (const thread of threads) assert.deepEqual(thread.requests[0].pieces, pieces);
  assert.equal(pool.capacity, 6);
});

test("a job goes to the worker with the fewest", () => {
  const { pool, threads, results } = makePool(2);
  for (const id of [1, 2, 3]) pool.decode(job(id));
  assert.deepEqual(threads.map(jobsOf), [[1, 3], [2]]);
  threads[0].reply({ type: "decoded", id: 1, status: OK, parts: [] });
  threads[0].reply({ type: "decoded", id: 3, status: OK, parts: [] });
  pool.decode(job(4));
  assert.deepEqual(threads.map(jobsOf), [[1, 3, 4], [2]]);
  assert.deepEqual(results.map(({ id }) => id), [1, 3]);
});

test("a worker that stops ends all of them and is reported once", () => {
  for (const stop of [
    (thread) => thread.reply({ type: "failed", failure: "no memory", outOfMemory: true }),
    (thread) => thread.onerror({ message: "no memory" }),
  ]) {
    const { pool, threads, results, failures } = makePool(2);
    pool.decode(job(1));
    stop(threads[1]);
    threads[0].reply({ type: "failed", failure: "no memory", outOfMemory: true });
    assert.equal(failures.length, 1);
    assert.match(failures[0].message, /no memory/);
    assert.ok(threads.every(({ ended }) => ended));
    threads[0].reply({ type: "decoded", id: 1, status: OK, parts: [] });
    assert.deepEqual(results, []);
  }
});

test("a closed pool ends its workers and passes nothing on", () => {
  const { pool, threads, results, failures } = makePool(1);
  pool.decode(job(1));
  pool.close();
  threads[0].reply({ type: "decoded", id: 1, status: OK, parts: [] });
  assert.ok(threads[0].ended);
  assert.deepEqual([results, failures], [[], []]);
});

const parts = (count) => Array.from({ length: count }, () => ({ primitives: 5, words: new ArrayBuffer(16) }));
const change = (segment, decoded) => ({ segment, decoded, begin: 0, end: 9, origin: 3 });

test("a version of a segment replaces the parts of the last one, and drops those beyond it", () => {
  const messages = [];
  const shown = new ShownParts(1, (message) => messages.push(message));
  shown.keep(1, parts(3));
  shown.show(change(7, 1));
  const first = messages.splice(0).map(({ segment }) => segment);
  assert.deepEqual(first.map(({ shDegree, end, origin }) => [shDegree, end, origin]), Array(3).fill([1, 9, 3]));
  shown.keep(2, parts(2));
  shown.show(change(7, 2));
  const ids = first.map(({ id }) => id);
  assert.deepEqual(messages.map((message) => message.segment?.id ?? message.id), ids);
  assert.deepEqual(messages.splice(0).map(({ type }) => type), ["segment", "segment", "dropped"]);
  shown.show(change(7, 0));
  assert.deepEqual(messages.splice(0), [{ type: "dropped", id: ids[0] }, { type: "dropped", id: ids[1] }]);
});

test("parts of different segments have different ids", () => {
  const ids = new Set();
  const shown = new ShownParts(0, ({ segment }) => ids.add(segment.id));
  for (const segment of [0, 1, 2 ** 27]) {
    shown.keep(segment + 1, parts(100));
    shown.show(change(segment, segment + 1));
  }
  assert.equal(ids.size, 300);
});

test("parts that are released are not shown", () => {
  const messages = [];
  const shown = new ShownParts(0, (message) => messages.push(message));
  shown.keep(1, parts(1));
  shown.release(1);
  shown.show(change(0, 1));
  assert.deepEqual(messages, []);
});
