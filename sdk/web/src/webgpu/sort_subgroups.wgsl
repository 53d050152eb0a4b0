// SPDX-License-Identifier: Apache-2.0
// scatter() of sort.wgsl with subgroup operations. Each subgroup processes a part of the tile, and reads
// as many keys at a time as it has lanes. Subgroups are full and have one size; kLanes is a multiple of it,
// and at most kMaxSubgroups times it. radix_sort.ts writes kIsWide, whether subgroups exceed 32 lanes.

const kMaxSubgroups = 8u;

var<workgroup> subgroup_count: atomic<u32>;
// Per subgroup and digit: the number of keys, later the position of the next key.
var<workgroup> places: array<atomic<u32>, kMaxSubgroups * kDigits>;

// Numbers the subgroups in any order: WGSL does not state which lanes form one.
fn number_of_subgroup() -> u32 {
  var number = 0u;
  if (subgroupElect()) { number = atomicAdd(&subgroup_count, 1u); }
  return subgroupBroadcastFirst(number);
}

// The bits of the lanes before a lane.
fn lanes_before(lane: u32) -> vec4<u32> {
  let at = vec4<i32>(i32(lane)) - vec4<i32>(0, 32, 64, 96);
  let low = (vec4<u32>(1u) << (vec4<u32>(clamp(at, vec4<i32>(0), vec4<i32>(31))))) - 1u;
  return select(low, vec4<u32>(0xffffffffu), at >= vec4<i32>(32));
}

fn ballot(vote: bool) -> vec4<u32> {
  let lanes = subgroupBallot(vote);
  if (kIsWide) { return lanes; }
  return vec4<u32>(lanes.x, 0u, 0u, 0u);
}

fn count_of(lanes: vec4<u32>) -> u32 {
  let counts = countOneBits(lanes);
  if (kIsWide) { return counts.x + counts.y + counts.z + counts.w; }
  return counts.x;
}

fn lowest_of(lanes: vec4<u32>) -> u32 {
  if (lanes.x != 0u || !kIsWide) { return firstTrailingBit(lanes.x); }
  if (lanes.y != 0u) { return 32u + firstTrailingBit(lanes.y); }
  if (lanes.z != 0u) { return 64u + firstTrailingBit(lanes.z); }
  return 96u + firstTrailingBit(lanes.w);
}

// Returns the lanes that have a key with the same digit.
fn peers_of(digit: u32, has_key: bool) -> vec4<u32> {
  var peers = ballot(has_key);
  for (var bit = 1u; bit < kDigits; bit <<= 1u) {
    let is_set = (digit & bit) != 0u;
    let lanes = ballot(is_set);
    peers &= select(~lanes, lanes, is_set);
  }
  return peers;
}

// Replaces the counts of the subgroups by the positions of their first keys.
fn find_places_of_subgroups(lane: u32, subgroups: u32) {
  for (var d = lane; d < kDigits; d += kLanes) {
    var place = next[d];
    for (var s = 0u; s < subgroups; s++) {
      let count = atomicLoad(&places[s * kDigits + d]);
      atomicStore(&places[s * kDigits + d], place);
      place += count;
    }
  }
}

@compute @workgroup_size(kLanes)
fn scatter(@builtin(workgroup_id) workgroup: vec3<u32>,
           @builtin(local_invocation_index) lane: u32,
           @builtin(subgroup_invocation_id) sublane: u32,
           @builtin(subgroup_size) size: u32) {
  let n = uniform_keys_of_pass(lane);
  let tile = workgroup.x;
  if (tile * kTile >= n) { return; }
  find_places(tile, n, lane);
  let subgroups = kLanes / size;
  let subgroup = number_of_subgroup();
  let part = kTile / subgroups;
  let first = tile * kTile + subgroup * part;
  for (var k = sublane; k < part; k += size) {
    if (first + k >= n) { break; }
    let key = pair_at(first + k).x;
    if (key != kHole) { atomicAdd(&places[subgroup * kDigits + digit_of(key)], 1u); }
  }
  workgroupBarrier();
  find_places_of_subgroups(lane, subgroups);
  workgroupBarrier();
  let before = lanes_before(sublane);
  for (var k = 0u; k < part; k += size) {
    let i = first + k + sublane;
    var pair = vec2<u32>(kHole);
    if (i < n) { pair = pair_at(i); }
    let digit = digit_of(pair.x);
    let has_key = pair.x != kHole;
    let peers = peers_of(digit, has_key);
    let leader = lowest_of(peers);
    var place = 0u;
    if (has_key && leader == sublane) {
      place = atomicAdd(&places[subgroup * kDigits + digit], count_of(peers));
    }
    // A lane without a key has no leader, but takes part in the shuffle with any lane number.
    place = subgroupShuffle(place, select(sublane, leader, has_key));
    if (has_key) { pairs_out[place + count_of(peers & before)] = pair; }
  }
}
