// SPDX-License-Identifier: Apache-2.0
// The rows of an atlas. usage: node --test test_rows.mjs
import assert from "node:assert/strict";
import { test } from "node:test";
import { importSource } from "./import_source.mjs";

const { RowAllocator } = await importSource("src/webgl2/rows.ts");

function allocatorOf(rows) {
  const allocator = new RowAllocator();
  allocator.grow(rows);
  return allocator;
}

test("ranges do not overlap, and a full allocator returns -1", () => {
  const allocator = allocatorOf(10);
  assert.deepEqual([4, 4, 4, 2, 1].map((count) => allocator.allocate(count)), [0, 4, -1, 8, -1]);
});

test("freed neighbours become one range", () => {
  const allocator = allocatorOf(9);
  for (let k = 0; k < 3; ++k) allocator.allocate(3);
  allocator.release(0, 3);
  allocator.release(6, 3);
  assert.equal(allocator.allocate(4), -1);
  allocator.release(3, 3);
  assert.equal(allocator.allocate(9), 0);
});

test("growing extends a free range at the end", () => {
  const allocator = allocatorOf(8);
  allocator.allocate(5);
  assert.equal(allocator.rowsFor(7), 12);
  allocator.grow(12);
  assert.equal(allocator.rows, 12);
  assert.equal(allocator.allocate(7), 5);
  assert.equal(allocator.rowsFor(2), 14);
});
