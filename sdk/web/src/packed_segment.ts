// SPDX-License-Identifier: Apache-2.0
// The sizes of packed segments (player/src/packed_segment.h).
import type { PackedSegment } from "./types";

/** Returns the number of entries of the arrays of a packed segment. */
export function padded(primitives: number): number {
  return Math.ceil(primitives / 256) * 256;
}

/** Returns the bytes of a packed segment. */
export function packedBytes(primitives: number, shDegree: number): number {
  const planes = Math.ceil((3 * (shDegree + 1) ** 2) / 4);
  return padded(primitives) * (72 + 8 * planes);
}

/** Throws an Error if the words of a segment have another size than its fields state. */
export function checkWords({ id, primitives, shDegree, words }: PackedSegment): void {
  const bytes = packedBytes(primitives, shDegree);
  if (words.byteLength === bytes) return;
  throw new Error(
    `segment ${id}: ${words.byteLength} bytes of words (expected ${bytes} ` +
    `for ${primitives} primitives of SH degree ${shDegree})`);
}
