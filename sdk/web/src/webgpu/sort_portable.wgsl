// SPDX-License-Identifier: Apache-2.0
// scatter() of sort.wgsl without subgroup operations: the lanes mark their keys in a bit mask per digit.
// Each lane has kPerLane keys of a batch, kLanes apart.

const kPerLane = 4u;
const kBatch = kLanes * kPerLane;
const kWords = kBatch / 32u;  // of a mask

// Word by word: per digit, a bit for each key of the batch, set if the key has this digit.
var<workgroup> masks: array<atomic<u32>, kWords * kDigits>;

// The number of keys of a mask before a position, and whether no key follows it.
struct Place {
  before: u32,
  is_last: bool,
}

fn place_of(digit: u32, word: u32, bit: u32) -> Place {
  var before = 0u;
  var behind = 0u;
  for (var w = 0u; w < kWords; w++) {
    let mask = atomicLoad(&masks[w * kDigits + digit]);
    if (w < word) { before += countOneBits(mask); }
    if (w == word) {
      before += countOneBits(mask & ((1u << bit) - 1u));
      behind |= (mask >> bit) >> 1u;
    }
    if (w > word) { behind |= mask; }
  }
  return Place(before, behind == 0u);
}

@compute @workgroup_size(kLanes)
fn scatter(@builtin(workgroup_id) workgroup: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
  let n = uniform_keys_of_pass(lane);
  let tile = workgroup.x;
  if (tile * kTile >= n) { return; }
  find_places(tile, n, lane);
  let bit = lane & 31u;
  for (var batch = tile * kTile; batch < min(n, (tile + 1u) * kTile); batch += kBatch) {
    var pairs: array<vec2<u32>, kPerLane>;
    for (var k = 0u; k < kPerLane; k++) {
      let i = batch + k * kLanes + lane;
      pairs[k] = vec2<u32>(kHole);
      if (i < n) { pairs[k] = pair_at(i); }
      if (pairs[k].x == kHole) { continue; }
      let word = (k * kLanes + lane) / 32u;
      atomicOr(&masks[word * kDigits + digit_of(pairs[k].x)], 1u << bit);
    }
    workgroupBarrier();
    var after: array<u32, kPerLane>;  // `next` of the digit, from its last key of the batch; or 0
    for (var k = 0u; k < kPerLane; k++) {
      if (pairs[k].x == kHole) { continue; }
      let digit = digit_of(pairs[k].x);
      let place = place_of(digit, (k * kLanes + lane) / 32u, bit);
      let to = next[digit] + place.before;
      pairs_out[to] = pairs[k];
      after[k] = select(0u, to + 1u, place.is_last);
    }
    workgroupBarrier();
    for (var k = 0u; k < kPerLane; k++) {
      if (pairs[k].x == kHole) { continue; }
      let digit = digit_of(pairs[k].x);
      atomicStore(&masks[(k * kLanes + lane) / 32u * kDigits + digit], 0u);
      if (after[k] != 0u) { next[digit] = after[k]; }
    }
    workgroupBarrier();
  }
}
