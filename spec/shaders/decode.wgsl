// SPDX-License-Identifier: Apache-2.0
// Decodes the units of a record to the integers q of its streams (stgs-format.md 7, 8.1 to 8.4)
// with unsigned 32-bit integers alone. decode.comp is the same algorithm in GLSL.
//
// A workgroup decodes a unit (6.5): first block after block, from bytes to the values of 8.1, then
// stream after stream, from values to integers, in place. Each invocation is a lane of the blocks.
// This favours clarity: a fast decoder has a workgroup for each block, and sums with a scan.

const kLanes = 32u;                                         // invocations; lanes of a long block
const kBlock = 8192u;                                       // symbols of a plane in a block (7.1)
const kTotal = 4096u;                                       // of the frequencies of a table (7.2)
const kLow = 65536u;                                        // the least state (7.3)
const kKeys = 1u << 30u;                                    // keys are below (8.4)
const kBytes = 0u; const kRans = 1u;                        // coders (6.4)
const kZigzag = 1u; const kDelta = 2u; const kMorton = 3u;  // predictions (8.3)

struct Unit {
  offset: u32, size: u32,     // of its first byte in `bytes`; in bytes
  coder: u32, symbols: u32,   // of its streams; n of each of their planes
  plane: u32, planes: u32,    // first in `tables`, and count, including constant planes
  stream: u32, streams: u32,  // first in `streams`, and count
}
struct Stream {
  at: u32,                           // of q[0] of component 0 in `q`; the others follow, n each
  components: u32,                   // as in 8.1; with prediction 3 four: x, y, z, keys
  prediction: u32,                   // 8.3
  low: u32, first_key: u32,          // 8.4
  digits: u32, bits: array<u32, 8>,  // d, and the bits of each digit
}

@group(0) @binding(0) var<storage> bytes: array<u32>;  // four in each, lowest first
// 4096 entries for each table, by slot (7.2). An entry has slot - start[s] in bits 0 to 11,
// f[s] - 1 in bits 12 to 23 and the slot's symbol s in bits 24 to 31.
@group(0) @binding(1) var<storage> lookups: array<u32>;
@group(0) @binding(2) var<storage> units: array<Unit>;
@group(0) @binding(3) var<storage> streams: array<Stream>;
@group(0) @binding(4) var<storage> tables: array<u32>;         // by plane, for coder 1
@group(0) @binding(5) var<storage, read_write> q: array<u32>;  // two's complement
// By unit: 0 initially, then the failed checks. 1: sizes or states (6.4, 7.1, 7.3), 2: the end of a
// block (7.4), 4: keys (8.4). If it is not 0, the record is refused and the integers are arbitrary.
@group(0) @binding(6) var<storage, read_write> damage: array<atomic<u32>>;

var<private> lane: u32;  // of this invocation
var<private> x: u32;     // its state
// Of the block's words: the offset of the next in `bytes`, and after the last.
var<private> next: u32; var<private> end: u32;
// A bit for each lane that needs a word in a step. Three take turns: one is in use, one is set to 0
// for the next step, and one may still be read by slower invocations.
var<workgroup> needy: array<atomic<u32>, 3>;
var<private> turn: u32;

fn byte_at(i: u32) -> u32 { return (bytes[i / 4u] >> (8u * (i % 4u))) & 255u; }
fn u16_at(i: u32) -> u32 { return byte_at(i) | (byte_at(i + 1u) << 8u); }
fn u32_at(i: u32) -> u32 { return u16_at(i) | (u16_at(i + 2u) << 16u); }

// Returns whether a table has one symbol: its planes are constant, and not in the group (7.2).
fn is_constant(t: u32) -> bool { return lookups[kTotal * t] / kTotal % kTotal == kTotal - 1u; }

// Returns the number of planes in the bytes of a unit.
fn stored_planes(unit: Unit) -> u32 {
  var count = 0u;
  for (var p = unit.plane; p < unit.plane + unit.planes; p++) {
    if (unit.coder == kBytes || !is_constant(tables[p])) { count += 1u; }
  }
  return count;
}

fn lanes_of(m: u32) -> u32 {  // 7.1
  var lanes = 1u;
  while (256u * lanes < m) { lanes *= 2u; }
  return lanes;
}

// Finds the states and words of a block (7.3). Returns whether they are in the unit. For the last
// block, this checks the sizes of all blocks.
fn open_block(unit: Unit, block: u32, blocks: u32) -> bool {
  if (unit.size / 4u < blocks - 1u) { return false; }
  var at = unit.offset + 4u * (blocks - 1u);
  var left = unit.size - 4u * (blocks - 1u);
  for (var k = 0u; k <= block; k++) {
    let lanes = lanes_of(min(kBlock, unit.symbols - kBlock * k));
    if (left < 4u * lanes) { return false; }
    left -= 4u * lanes;
    var words = left / 2u;
    if (k + 1u < blocks) { words = u32_at(unit.offset + 4u * k); }
    else if (left % 2u != 0u) { return false; }
    if (words > left / 2u) { return false; }
    left -= 2u * words;
    x = kLow;
    if (lane < lanes) { x = u32_at(at + 4u * lane); }
    next = at + 4u * lanes;
    at = next + 2u * words;
    end = at;
  }
  return true;
}

// Returns the next symbol of this lane (7.4). Lanes without a symbol in this step call it too.
fn next_symbol(table: u32, in_step: bool) -> u32 {
  let entry = lookups[kTotal * table + x % kTotal]; let f = entry / kTotal % kTotal + 1u;
  if (in_step) { x = f * (x / kTotal) + entry % kTotal; }
  let needs_word = in_step && x < kLow;
  if (needs_word) { atomicOr(&needy[turn % 3u], 1u << lane); }
  if (lane == 0u) { atomicStore(&needy[(turn + 1u) % 3u], 0u); }
  workgroupBarrier();
  let lanes = atomicLoad(&needy[turn % 3u]);
  let at = next + 2u * countOneBits(lanes & ((1u << lane) - 1u));
  if (needs_word) { x = kLow * x; if (at < end) { x += u16_at(at); } }
  next += 2u * countOneBits(lanes);  // past `end` if words are missing
  turn += 1u;
  return entry >> 24u;
}

// Adds m symbols of a plane, from v `first` on, to the values from q[at] on: a digit above
// `shift` bits (8.1).
fn decode_digit(unit: Unit, plane: u32, first: u32, m: u32, at: u32, shift: u32) {
  var table = 0u;
  if (unit.coder == kRans) { table = tables[unit.plane + plane]; }
  let constant = unit.coder == kRans && is_constant(table);
  let lanes = lanes_of(m);
  for (var step = 0u; lanes * step < m; step++) {
    let i = lanes * step + lane; let in_step = lane < lanes && i < m;
    var v = lookups[kTotal * table] >> 24u;
    if (unit.coder == kRans && !constant) { v = next_symbol(table, in_step); }
    if (in_step) {
      if (unit.coder == kBytes) { v = byte_at(unit.offset + plane * unit.symbols + first + i); }
      q[at + i] = select(q[at + i], 0u, shift == 0u) | (v << shift);
    }
  }
}

// Decodes the symbols of a block, plane after plane, to values (8.1, 8.4).
fn decode_block(unit: Unit, block: u32) {
  let n = unit.symbols; let first = kBlock * block; let m = min(kBlock, n - first);
  var plane = 0u;
  for (var s = unit.stream; s < unit.stream + unit.streams; s++) {
    let morton = streams[s].prediction == kMorton;
    for (var c = 0u; c < streams[s].components; c++) {
      let low = morton && c > 0u;
      let component = select(c, (c + 3u) % 4u, morton);  // the planes of the keys are the first
      let at = streams[s].at + n * component + first;
      let digits = select(streams[s].digits, (streams[s].low + 7u) / 8u, low); var shift = 0u;
      for (var d = 0u; d < digits; d++) {
        decode_digit(unit, plane, first, m, at, shift);
        shift += select(streams[s].bits[d], 8u, low);
        plane += 1u;
      }
    }
  }
}

// Replaces the values of a stream by integers (8.2 to 8.4). Returns whether all keys are in range.
fn predict(stream: Stream, n: u32) -> bool {
  let end = stream.at + n * stream.components; let keys = stream.at + n * 3u;
  let zigzag = stream.prediction == kZigzag || stream.prediction == kDelta;
  for (var at = stream.at + lane; zigzag && at < end; at += kLanes) {
    q[at] = (q[at] / 2u) ^ (0u - q[at] % 2u);
  }
  storageBarrier();
  if (stream.prediction == kDelta && lane < stream.components) {
    let at = stream.at + n * lane;
    for (var i = 1u; i < n; i++) { q[at + i] += q[at + i - 1u]; }
  }
  var key = stream.first_key; var in_range = true;
  for (var at = keys; stream.prediction == kMorton && lane == 0u && at < end; at++) {
    in_range = in_range && key < kKeys && q[at] < kKeys && key + q[at] < kKeys;
    key += q[at];
    q[at] = key;
  }
  storageBarrier();
  for (var i = lane; stream.prediction == kMorton && i < 3u * n; i += kLanes) {
    let at = stream.at + i; var h = 0u;
    for (var j = 0u; j < 10u; j++) { h |= ((q[keys + i % n] >> (3u * j + i / n)) & 1u) << j; }
    q[at] = (h << stream.low) + select(q[at], 0u, stream.low == 0u);
  }
  return in_range;
}

@compute @workgroup_size(kLanes)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) invocation: u32) {
  lane = invocation;
  let unit = units[group.x]; let n = unit.symbols;
  let planes = stored_planes(unit); let blocks = n / kBlock + min(1u, n % kBlock);
  let coded = unit.coder == kRans && planes > 0u && n > 0u;
  var fits = coded || unit.size == 0u;  // Otherwise there is a byte for each symbol.
  if (!coded && planes > 0u) { fits = unit.size / planes == n && unit.size % planes == 0u; }
  var failed = 0u;
  for (var block = 0u; fits && block < blocks; block++) {
    if (coded) { fits = open_block(unit, block, blocks); }
    if (coded && x < kLow) { failed |= 1u; }
    if (fits) { decode_block(unit, block); }
    if (coded && (next != end || x != kLow)) { failed |= 2u; }
  }
  storageBarrier();
  for (var s = unit.stream; s < unit.stream + unit.streams; s++) {
    if (!predict(streams[s], n)) { failed |= 4u; }
  }
  if (!fits) { failed |= 1u; }
  if (failed != 0u) { atomicOr(&damage[group.x], failed); }
}
