// SPDX-License-Identifier: Apache-2.0
// A stable radix sort of the visible slots by depth: keys of 24 bits, in passes of 8 bits. Each pass
// counts the digits of tiles of keys, sums the counts over chunks of tiles, and scatters the pairs
// (sort_portable.wgsl or sort_subgroups.wgsl). The first pass reads the depths of slots, of which some
// are not visible, and writes only the visible ones. The sort does not rely on forward progress.
// radix_sort.ts writes kLanes, the lanes per workgroup, kTile, the keys per workgroup, and kChunk, the
// tiles per chunk, before this text.
#include "drawn.wgsl"

struct Sorting {
  shift: u32,     // of the digit
  is_first: u32,  // 1: the keys are those of slots
  slots: u32,
  tiles: u32,     // that `counts` has space for; a multiple of kChunk
}

@group(0) @binding(0) var<uniform> sorting: Sorting;
// Per slot: the bits of the depth, or kHole.
@group(0) @binding(1) var<storage, read> depths: array<u32>;
// Key and slot.
@group(0) @binding(2) var<storage, read> pairs_in: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> pairs_out: array<vec2<u32>>;
// Tile by tile: the number of keys with each digit; after sum_chunk(), in earlier tiles of the chunk.
// Then, chunk by chunk: the number of keys with each digit.
@group(0) @binding(4) var<storage, read_write> counts: array<u32>;
@group(0) @binding(5) var<storage, read_write> drawn: array<atomic<u32>, kDrawnWords>;

const kKeyBits = 24u;
const kDigits = 256u;

fn keys_of_pass() -> u32 {
  return select(atomicLoad(&drawn[kCount]), sorting.slots, sorting.is_first != 0u);
}

// Of a tile of slots, as in `drawn`.
var<workgroup> lowest: atomic<u32>;
var<workgroup> highest: atomic<u32>;

// Before the first pass.
@compute @workgroup_size(kLanes)
fn find_range(@builtin(workgroup_id) workgroup: vec3<u32>,
              @builtin(local_invocation_index) lane: u32) {
  let first = workgroup.x * kTile;
  var low = 0u;
  var high = 0u;
  for (var i = first + lane; i < min(sorting.slots, first + kTile); i += kLanes) {
    let bits = depths[i];
    if (bits != kHole) {
      low = max(low, ~bits);
      high = max(high, bits);
    }
  }
  atomicMax(&lowest, low);
  atomicMax(&highest, high);
  workgroupBarrier();
  if (lane == 0u && atomicLoad(&lowest) != 0u) {
    atomicMax(&drawn[kLowest], atomicLoad(&lowest));
    atomicMax(&drawn[kHighest], atomicLoad(&highest));
  }
}

// Returns the key of a depth. The bits of depths have the order of the depths, which are positive. If the
// range of the bits exceeds kKeyBits, the lowest bits are dropped.
fn key_of_depth(bits: u32) -> u32 {
  let lowest = ~atomicLoad(&drawn[kLowest]);
  let range_bits = 32u - countLeadingZeros(atomicLoad(&drawn[kHighest]) - lowest);
  return (bits - lowest) >> (max(range_bits, kKeyBits) - kKeyBits);
}

// Returns the key and the slot of entry i < keys_of_pass(); the key is kHole if the slot is not visible.
fn pair_at(i: u32) -> vec2<u32> {
  if (sorting.is_first == 0u) { return pairs_in[i]; }
  let bits = depths[i];
  return vec2<u32>(select(key_of_depth(bits), kHole, bits == kHole), i);
}

fn digit_of(key: u32) -> u32 {
  return (key >> sorting.shift) & (kDigits - 1u);
}

var<workgroup> histogram: array<atomic<u32>, kDigits>;

@compute @workgroup_size(kLanes)
fn count(@builtin(workgroup_id) workgroup: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
  let tile = workgroup.x;
  let end = min(keys_of_pass(), (tile + 1u) * kTile);
  for (var i = tile * kTile + lane; i < end; i += kLanes) {
    let key = pair_at(i).x;
    if (key != kHole) { atomicAdd(&histogram[digit_of(key)], 1u); }
  }
  workgroupBarrier();
  for (var d = lane; d < kDigits; d += kLanes) {
    counts[tile * kDigits + d] = atomicLoad(&histogram[d]);
  }
}

// A lane per digit, in four workgroups per chunk.
@compute @workgroup_size(64)
fn sum_chunk(@builtin(workgroup_id) workgroup: vec3<u32>,
             @builtin(local_invocation_index) lane: u32) {
  let digit = workgroup.y * 64u + lane;
  let first = workgroup.x * kChunk;
  let tiles = (keys_of_pass() + kTile - 1u) / kTile;
  var found: array<u32, kChunk>;
  for (var k = 0u; k < kChunk; k++) {
    found[k] = 0u;
    if (first + k < tiles) { found[k] = counts[(first + k) * kDigits + digit]; }
  }
  var before = 0u;
  for (var k = 0u; k < kChunk; k++) {
    counts[(first + k) * kDigits + digit] = before;
    before += found[k];
  }
  counts[(sorting.tiles + workgroup.x) * kDigits + digit] = before;
}

const kDigitsPerLane = kDigits / kLanes;
var<workgroup> lane_sums: array<u32, kLanes>;
var<workgroup> group_sums: array<u32, kLanes / 16u>;  // of 16 lanes
// Per digit: the position of the next key with this digit.
var<workgroup> next: array<u32, kDigits>;

// Sets next[digit] to the number of keys with this digit in earlier tiles. Returns the number in all tiles.
fn count_before(tile: u32, chunks: u32, digit: u32) -> u32 {
  let chunk = tile / kChunk;
  var before = counts[tile * kDigits + digit];
  var sum = 0u;
  for (var k = 0u; k < chunks; k++) {
    let count = counts[(sorting.tiles + k) * kDigits + digit];
    if (k < chunk) { before += count; }
    sum += count;
  }
  next[digit] = before;
  return sum;
}

// Sets `next` for a tile: the number of keys with lower digits, and of keys with the same digit in earlier
// tiles. The first tile also writes `drawn`. All lanes must call it.
fn find_places(tile: u32, n: u32, lane: u32) {
  let chunks = (n + kChunk * kTile - 1u) / (kChunk * kTile);
  let first = lane * kDigitsPerLane;
  var sums: array<u32, kDigitsPerLane>;  // of the lower digits of the lane
  var sum = 0u;
  for (var k = 0u; k < kDigitsPerLane; k++) {
    sums[k] = sum;
    sum += count_before(tile, chunks, first + k);
  }
  lane_sums[lane] = sum;
  workgroupBarrier();
  if (lane < kLanes / 16u) {
    var group_sum = 0u;
    for (var i = 16u * lane; i < 16u * lane + 16u; i++) { group_sum += lane_sums[i]; }
    group_sums[lane] = group_sum;
  }
  workgroupBarrier();
  var before = 0u;
  for (var i = 0u; i < lane / 16u; i++) { before += group_sums[i]; }
  for (var i = lane & ~15u; i < lane; i++) { before += lane_sums[i]; }
  for (var k = 0u; k < kDigitsPerLane; k++) { next[first + k] += before + sums[k]; }
  if (lane == kLanes - 1u && tile == 0u && sorting.is_first != 0u) {
    let total = before + sum;
    atomicStore(&drawn[0], 6u * kQuads);
    atomicStore(&drawn[1], (total + kQuads - 1u) / kQuads);
    for (var k = 2u; k < kCount; k++) { atomicStore(&drawn[k], 0u); }
    atomicStore(&drawn[kCount], total);
  }
  if (lane == 0u && tile == 0u && sorting.is_first == 0u) {
    atomicStore(&drawn[kLowest], 0u);
    atomicStore(&drawn[kHighest], 0u);
  }
  workgroupBarrier();
}

var<workgroup> key_count: u32;

// Returns keys_of_pass() as a value that is uniform for all lanes.
fn uniform_keys_of_pass(lane: u32) -> u32 {
  if (lane == 0u) { key_count = keys_of_pass(); }
  return workgroupUniformLoad(&key_count);
}
