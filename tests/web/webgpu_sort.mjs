// SPDX-License-Identifier: Apache-2.0
// Compares the sort on the GPU with one on the CPU. See test_webgpu.py.
import { kCountWord, RadixSort } from "./radix_sort.js";

/** The depth of a slot that is not visible, as in drawn.wgsl. */
const kHole = 0xffffffff;

/** A generator of 32-bit integers with a fixed seed. */
function randomIntegers(seed) {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return (state ^ (state >>> 15)) >>> 0;
  };
}

/** Sizes around those of a mask, a workgroup, a batch and a tile, and one of several chunks of tiles. */
const kSizes = [1, 31, 32, 33, 63, 64, 65, 255, 256, 257, 4095, 4096, 4097, 70001];
const kLargeSizes = [4097, 70001];

/** Bits of the depths of slots; for small sizes, only the last three. */
const kKinds = {
  near: (next) => 0x40000000 + (next() >>> 8), // keys have all their bits
  digit: (next) => 0x3f800000 + ((next() >>> 31) << 16), // only the last pass moves anything
  sparse: (next) => ((next() >>> 9) & 63 ? kHole : next() >>> 2),
  equal: () => 0x7f7fffff,
  none: () => kHole,
  any: (next) => next() >>> 1, // the lowest bits are dropped
  few: (next) => (next() >>> 29) << 27, // stability
  holes: (next) => ((next() >>> 9) & 1 ? kHole : next() >>> 12),
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

/** The visible slots by the 24 highest bits of the range of the depths; equal ones by slot. */
function expectedOf(depths) {
  const slots = [...depths.keys()].filter((slot) => depths[slot] !== kHole);
  const [least, greatest] = slots.reduce(
    ([low, high], slot) => [Math.min(low, depths[slot]), Math.max(high, depths[slot])], [kHole, 0]);
  const dropped = Math.max(0, 32 - Math.clz32(greatest - least) - 24);
  const keyOf = (slot) => (depths[slot] - least) >>> dropped;
  return slots.sort((a, b) => keyOf(a) - keyOf(b) || a - b);
}

async function isSorted(device, sort, depths) {
  const size = depths.length;
  sort.reserve(size);
  device.queue.writeBuffer(sort.depths, 0, depths);
  const encoder = device.createCommandEncoder();
  const pass = encoder.beginComputePass();
  sort.encode(pass);
  pass.end();
  device.queue.submit([encoder.finish()]);
  const drawn = await read(device, sort.drawn, 32);
  const order = await read(device, sort.order, 8 * size);
  const expected = expectedOf(depths);
  return drawn[kCountWord] === expected.length && drawn[0] === 6 * 64 &&
    drawn[1] === Math.ceil(expected.length / 64) &&
    expected.every((slot, k) => slot === order[2 * k + 1]);
}

/** Returns the names of the cases that differ, and the number of cases, of a device and a sort. */
export async function testSort(device, kind) {
  const sort = await RadixSort.create(device, kind);
  const next = randomIntegers(5);
  const wrong = [];
  let cases = 0;
  for (const size of [...kSizes, 300]) { // the last in buffers that are much larger
    const kinds = Object.entries(kKinds);
    for (const [name, bits] of kLargeSizes.includes(size) ? kinds : kinds.slice(-3)) {
      const depths = Uint32Array.from({ length: size }, () => bits(next));
      if (!(await isSorted(device, sort, depths))) wrong.push(`${size} ${name}`);
      ++cases;
    }
  }
  sort.destroy();
  return { wrong, cases };
}
