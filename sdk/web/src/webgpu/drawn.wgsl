// SPDX-License-Identifier: Apache-2.0
// The depths of slots and the words of `drawn`, shared by project.wgsl, sort.wgsl and splat.wgsl.

// The depth of a slot that is not visible. Other depths are the bits of floats that are not negative.
const kHole = 0xffffffffu;

// `drawn`: the arguments of the indirect draw, then the words at these indices.
const kDrawnWords = 8u;  // as in radix_sort.ts
const kCount = 5u;       // the number of visible slots; kCountWord of radix_sort.ts
// The complement of the smallest depth, and the largest depth; 0 between frames.
const kLowest = 6u;
const kHighest = 7u;

// Rectangles of splats per instance of the draw, as in pipelines.ts.
const kQuads = 64u;
