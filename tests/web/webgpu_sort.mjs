// SPDX-License-Identifier: Apache-2.0
// Compares the sort on the GPU with one on the CPU. See test_webgpu.py.
import { kCountWord, kHole, RadixSort } from "./radix_sort.js";

/** A generator of 32-bit integers with a fixed seed. */
function randomIntegers(seed) {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return (state ^ (state >>> 15)) >>> 0;
  };
}

/** Sizes around those of a lane, a workgroup and a tile, and one of many tiles. */
const kSizes = [1, 2, 15, 16, 17, 31, 32, 33, 63, 64, 65, 2047, 2048, 2049, 4095, 4097, 70001];

/** Keys of a slot: any, few different ones, holes with a probability of 1/2, all equal, no key. */
const kKinds = {
  any: (next) => next() >>> 4,
  few: (next) => (next() >>> 29) << 20,
  holes: (next) => ((next() >>> 9) & 1 ? kHole : next() >>> 12),
  equal: () => 0x0fffffff,
  none: () => kHole,
};

async function read(device, buffer, bytes) {
  const usage = GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST;
  const copy = device.createBuffer({ size: bytes, usage });
  const encoder = device.createCommandEncoder();
  encoder.copyBufferToBuffer(buffer, 0, copy, 0, bytes);
  device.queue.submit([encoder.finish()]);
  await copy.mapAsync(GPUMapMode.READ);
  const words = new Uint32Array(copy.getMappedRange().slice(0));
  copy.destroy();
  return words;
}

/** The slots with keys by key; equal ones by slot. */
function expectedOf(keys) {
  const slots = [...keys.keys()].filter((slot) => keys[slot] !== kHole);
  return slots.sort((a, b) => keys[a] - keys[b] || a - b);
}

/** Returns the names of the cases that differ, and the number of cases. */
export async function testSort() {
  const adapter = await navigator.gpu.requestAdapter();
  const device = await adapter.requestDevice();
  const sort = await RadixSort.create(device);
  const next = randomIntegers(5);
  const wrong = [];
  let cases = 0;
  for (const size of [...kSizes, 300]) { // the last in buffers that are much larger
    for (const [name, key] of Object.entries(kKinds)) {
      const keys = Uint32Array.from({ length: size }, () => key(next));
      sort.reserve(size);
      device.queue.writeBuffer(sort.keys, 0, keys);
      const encoder = device.createCommandEncoder();
      const pass = encoder.beginComputePass();
      sort.encode(pass, size);
      pass.end();
      device.queue.submit([encoder.finish()]);
      const drawn = await read(device, sort.drawn, 32);
      const expected = expectedOf(keys);
      const order = await read(device, sort.order, 4 * size);
      const isRight = drawn[kCountWord] === expected.length && drawn[0] === 6 * 64 &&
        drawn[1] === Math.ceil(expected.length / 64) &&
        expected.every((slot, k) => slot === order[k]);
      if (!isRight) wrong.push(`${size} ${name}`);
      ++cases;
    }
  }
  sort.destroy();
  device.destroy();
  return { wrong, cases };
}
