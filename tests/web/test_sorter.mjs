// SPDX-License-Identifier: Apache-2.0
// The depth order of active primitives. usage: node --test test_sorter.mjs
import assert from "node:assert/strict";
import { test } from "node:test";
import { importSource } from "./import_source.mjs";

const { DepthSorter, kSorterBytes } = await importSource("src/webgl2/sorter.ts");
const { padded } = await importSource("src/packed_segment.ts");

const kRequest = { direction: [0, 0, 1], offset: 0, near: 0.1, ticks: 0, until: 0 };

/** A generator of numbers in [0, 1) with a fixed seed. */
function randomNumbers(seed) {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

/**
 * A segment of primitives {x, y, z, time, u, v, w, begin, end}, as the first arrays of a packed
 * segment. Entries after the last primitive are never active.
 */
function segmentOf(key, id, primitives, fields = {}) {
  const n = padded(primitives.length);
  const floats = new Float32Array((kSorterBytes / 4) * n);
  for (let i = 0; i < n; ++i) floats.set([3e38, -3e38], 2 * i);
  primitives.forEach((one, i) => {
    const { x = 0, y = 0, z = 1, time = 0, u = 0, v = 0, w = 0, begin = -1e9, end = 1e9 } = one;
    floats.set([begin, end], 2 * i);
    floats.set([x, y, z, time], 2 * n + 4 * i);
    floats.set([u, v, w, 1], 6 * n + 4 * i);
  });
  return { key, id, primitives: primitives.length, begin: 0, end: 100, origin: 0,
    words: floats.buffer, ...fields };
}

function sorterOf(...segments) {
  const sorter = new DepthSorter();
  for (const segment of segments) sorter.add(segment);
  return sorter;
}

function entriesOf(order) {
  return [...new Uint32Array(order.buffer, 0, order.count)];
}

test("farthest first", () => {
  const sorter = sorterOf(segmentOf(1, 0, [{ z: 2 }, { z: 5 }, { z: 1 }, { z: 3 }]));
  assert.deepEqual(entriesOf(sorter.sort(kRequest, null)), [1, 3, 0, 2]);
});

test("at equal depth, primitives with lower numbers are in front", () => {
  const sorter = sorterOf(
    segmentOf(7, 5, [{ z: 2 }, { z: 4 }]), segmentOf(8, 3, [{ z: 2 }, { z: 2 }]));
  const order = sorter.sort(kRequest, null);
  assert.deepEqual(order.keys, [8, 7]); // ascending ids
  assert.deepEqual(order.bases, [0, 256]);
  assert.deepEqual(entriesOf(order), [257, 256, 1, 0]);
});

test("random depths are ordered within the relative precision of 16 bits", () => {
  const random = randomNumbers(5);
  const depths = Array.from({ length: 5000 }, () => Math.exp(8 * random() - 2));
  const sorter = sorterOf(segmentOf(1, 0, depths.map((z) => ({ z }))));
  const entries = entriesOf(sorter.sort(kRequest, null));
  assert.deepEqual([...entries].sort((a, b) => a - b), depths.map((_, i) => i));
  for (let k = 1; k < entries.length; ++k) {
    assert.ok(depths[entries[k]] <= depths[entries[k - 1]] * (1 + 2 ** -11));
  }
});

test("close depths have an order of their own", () => {
  const depths = Array.from({ length: 2000 }, (_, i) => 5 + ((i * 7) % 2000) * 1e-5);
  const sorter = sorterOf(segmentOf(1, 0, depths.map((z) => ({ z }))));
  const entries = entriesOf(sorter.sort(kRequest, null));
  for (let k = 1; k < entries.length; ++k) {
    assert.ok(depths[entries[k]] < depths[entries[k - 1]]);
  }
});

test("depth follows the camera and the motion", () => {
  const sorter = sorterOf(
    segmentOf(1, 0, [{ x: 1, time: 2, u: 0 }, { x: -3, time: 2, u: 1 }], { origin: 10 }));
  const request = { direction: [1, 0, 0], offset: 4, near: 0.1 };
  assert.deepEqual(entriesOf(sorter.sort({ ...request, ticks: 12, until: 12 }, null)), [0, 1]);
  assert.deepEqual(entriesOf(sorter.sort({ ...request, ticks: 17, until: 17 }, null)), [1, 0]);
  assert.deepEqual(
    entriesOf(sorter.sort({ ...request, direction: [-1, 0, 0], ticks: 12, until: 12 }, null)),
    [1, 0]);
});

test("primitives are active in their support, ends included", () => {
  const sorter = sorterOf(segmentOf(1, 0, [{ begin: 2, end: 3 }], { origin: 40 }));
  const count = (ticks) => sorter.sort({ ...kRequest, ticks, until: ticks }, null).count;
  assert.deepEqual([41.99, 42, 42.5, 43, 43.01].map(count), [0, 1, 1, 1, 0]);
});

test("segments are shown at the times at which they are needed, ends included", () => {
  const sorter = sorterOf(
    segmentOf(1, 0, [{}], { begin: 10, end: 20 }), segmentOf(2, 1, [{}], { begin: 20, end: 30 }));
  const keys = (ticks) => sorter.sort({ ...kRequest, ticks, until: ticks }, null).keys;
  assert.deepEqual([9, 10, 20, 30, 31].map(keys), [[], [1], [1, 2], [2], []]);
});

test("primitives that become active until a time are sorted", () => {
  const sorter = sorterOf(
    segmentOf(1, 0, [{ begin: 4, end: 6 }], { begin: 4, end: 6 }), segmentOf(2, 1, [{ begin: 8 }]));
  const keys = (ticks, until) => {
    const order = sorter.sort({ ...kRequest, ticks, until }, null);
    return [order.keys, order.count];
  };
  assert.deepEqual(keys(3, 3.5), [[2], 0]);
  assert.deepEqual(keys(3, 4), [[1, 2], 1]);
  assert.deepEqual(keys(9, 6), [[1, 2], 2]); // in reverse
  assert.deepEqual(keys(7, 7), [[2], 0]);
});

test("removed segments are not sorted", () => {
  const sorter = sorterOf(segmentOf(1, 0, [{}]), segmentOf(2, 1, [{}, {}]));
  sorter.remove(1);
  sorter.remove(9);
  const order = sorter.sort(kRequest, null);
  assert.deepEqual([order.keys, order.bases, order.count], [[2], [0], 2]);
});

test("primitives without a depth in front of the camera do not disturb the order", () => {
  const depths = [3, -5, 1, NaN, 2, Infinity, 0.05];
  const sorter = sorterOf(segmentOf(1, 0, depths.map((z) => ({ z }))));
  const entries = entriesOf(sorter.sort(kRequest, null));
  assert.equal(entries.length, depths.length);
  assert.deepEqual(entries.slice(0, 3), [0, 4, 2]);
});

test("a large enough buffer is used again", () => {
  const sorter = sorterOf(segmentOf(1, 0, [{ z: 1 }, { z: 2 }, { z: 3 }]));
  const buffer = new ArrayBuffer(64);
  const order = sorter.sort(kRequest, buffer);
  assert.equal(order.buffer, buffer);
  assert.deepEqual(entriesOf(order), [2, 1, 0]);
  assert.notEqual(sorter.sort(kRequest, new ArrayBuffer(8)).buffer.byteLength, 8);
});

test("no primitives", () => {
  assert.equal(sorterOf().sort(kRequest, null).count, 0);
  assert.equal(sorterOf(segmentOf(1, 0, [])).sort(kRequest, null).count, 0);
});
