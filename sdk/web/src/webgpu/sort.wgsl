// SPDX-License-Identifier: Apache-2.0
// A stable radix sort of 28-bit keys, 4 bits at a time, without operations of subgroups. Each pass
// counts the digits of tiles of keys, makes offsets of the counts, and scatters keys and values. The
// first pass takes slots, of which some have no key, and writes only those that have one.

struct Sorting {
  shift: u32,     // of the digit
  is_first: u32,  // 1: the keys are those of slots
  slots: u32,
  stride: u32,    // tiles for which `counts` has space
}

@group(0) @binding(0) var<uniform> sorting: Sorting;
@group(0) @binding(1) var<storage, read> keys_in: array<u32>;
@group(0) @binding(2) var<storage, read> values_in: array<u32>;
@group(0) @binding(3) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(4) var<storage, read_write> values_out: array<u32>;
// Digit by digit: the number of keys with this digit in each tile; after offsets(), where the first of
// them goes.
@group(0) @binding(5) var<storage, read_write> counts: array<u32>;
// Arguments of the indirect draw and the number of keys.
@group(0) @binding(6) var<storage, read_write> drawn: array<u32, 8>;

const kHole = 0xffffffffu;  // no key
// Lanes per workgroup, and consecutive keys of a lane. With 256 lanes of 16 keys, the sort took six
// times as long in SwiftShader, where each lane that waits at a barrier costs much.
const kLanes = 64u;
const kPerLane = 32u;
const kTile = kLanes * kPerLane;  // kTile of radix_sort.ts
const kGroups = kLanes / 16u;     // of 16 lanes
const kCount = 5u;          // index into `drawn` of the number of keys
const kQuads = 64u;         // splats per instance; of splat.wgsl
const kStride = kLanes + 1u;  // of `ranks`; odd, so that the lanes of a scan use different banks

fn keys_of_pass() -> u32 {
  return select(drawn[kCount], sorting.slots, sorting.is_first != 0u);
}

fn digit_of(key: u32) -> u32 {
  return (key >> sorting.shift) & 15u;
}

// Whether entry i, of `key`, is sorted. Passes after the first have no holes.
fn is_sorted(key: u32) -> bool {
  return sorting.is_first == 0u || key != kHole;
}

// Two digits to a word, 16 bits each, which hold the keys of a tile; per pair of digits, per lane: the
// number of keys, then the rank of the next one among those of the tile.
var<workgroup> ranks: array<u32, 8u * kStride>;
// Sums over 16 lanes, per pair of digits; then over all lanes before them.
var<workgroup> sums: array<u32, 8u * kGroups>;

fn rank_index(digit: u32, lane: u32) -> u32 {
  return (digit >> 1u) * kStride + lane;
}

fn one_of(digit: u32) -> u32 {
  return 1u << (16u * (digit & 1u));
}

fn half_of(word: u32, digit: u32) -> u32 {
  return (word >> (16u * (digit & 1u))) & 0xffffu;
}

// Counts the keys of a lane in `ranks`.
fn count_lane(tile: u32, lane: u32, n: u32) {
  let first = tile * kTile + lane * kPerLane;
  for (var i = first; i < min(first + kPerLane, n); i++) {
    let key = keys_in[i];
    if (is_sorted(key)) { ranks[rank_index(digit_of(key), lane)] += one_of(digit_of(key)); }
  }
}

// Replaces the counts in `ranks` by those of the lanes before each in a group of 16, and writes the sums
// of the groups. A lane does that for one pair of digits and one group.
fn scan_groups(lane: u32) {
  if (lane >= 8u * kGroups) { return; }
  let pair = lane & 7u;
  let group = lane >> 3u;
  let first = pair * kStride + 16u * group;
  var sum = 0u;
  for (var i = first; i < first + 16u; i++) {
    let count = ranks[i];
    ranks[i] = sum;
    sum += count;
  }
  sums[pair * kGroups + group] = sum;
}

@compute @workgroup_size(kLanes)
fn count(@builtin(workgroup_id) workgroup: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
  count_lane(workgroup.x, lane, keys_of_pass());
  workgroupBarrier();
  scan_groups(lane);
  workgroupBarrier();
  if (lane < 16u) {
    var sum = 0u;
    for (var i = 0u; i < kGroups; i++) { sum += half_of(sums[(lane >> 1u) * kGroups + i], lane); }
    counts[lane * sorting.stride + workgroup.x] = sum;
  }
}

// Sums over parts of the tiles: 16 digits, 16 parts each.
var<workgroup> parts: array<u32, 256>;

// One workgroup for all tiles. The first pass also writes `drawn`.
@compute @workgroup_size(256)
fn offsets(@builtin(local_invocation_index) lane: u32) {
  let tiles = (keys_of_pass() + kTile - 1u) / kTile;
  let size = (tiles + 15u) / 16u;
  let row = (lane >> 4u) * sorting.stride;
  let first = min(tiles, (lane & 15u) * size);
  let end = min(tiles, first + size);
  var sum = 0u;
  for (var i = first; i < end; i++) { sum += counts[row + i]; }
  parts[lane] = sum;
  workgroupBarrier();
  var before = 0u;
  for (var i = 0u; i < lane; i++) { before += parts[i]; }
  if (lane == 255u && sorting.is_first != 0u) {
    let total = before + sum;
    drawn[0] = 6u * kQuads;
    drawn[1] = (total + kQuads - 1u) / kQuads;
    drawn[2] = 0u;
    drawn[3] = 0u;
    drawn[4] = 0u;
    drawn[kCount] = total;
  }
  for (var i = first; i < end; i++) {
    let count = counts[row + i];
    counts[row + i] = before;
    before += count;
  }
}

@compute @workgroup_size(kLanes)
fn scatter(@builtin(workgroup_id) workgroup: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
  let tile = workgroup.x;
  let n = keys_of_pass();
  count_lane(tile, lane, n);
  workgroupBarrier();
  scan_groups(lane);
  workgroupBarrier();
  if (lane < 8u) {
    var sum = 0u;
    for (var i = kGroups * lane; i < kGroups * (lane + 1u); i++) {
      let count = sums[i];
      sums[i] = sum;
      sum += count;
    }
  }
  workgroupBarrier();
  let first = tile * kTile + lane * kPerLane;
  for (var i = first; i < min(first + kPerLane, n); i++) {
    let key = keys_in[i];
    if (!is_sorted(key)) { continue; }
    let digit = digit_of(key);
    let index = rank_index(digit, lane);
    let rank = half_of(ranks[index] + sums[(digit >> 1u) * kGroups + (lane >> 4u)], digit);
    ranks[index] += one_of(digit);
    let to = counts[digit * sorting.stride + tile] + rank;
    keys_out[to] = key;
    var value = i;
    if (sorting.is_first == 0u) { value = values_in[i]; }
    values_out[to] = value;
  }
}
