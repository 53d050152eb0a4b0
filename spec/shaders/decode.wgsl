// SPDX-License-Identifier: Apache-2.0
// Decodes the units of a record to the integers q of its streams (stgs-format.md 7, 8.1 to 8.4)
// with unsigned 32-bit integers alone. decode.comp is the same algorithm in GLSL.
//
// A workgroup decodes a unit (6.5): first each invocation takes blocks, from bytes to the values of
// 8.1, then each takes a component, from values to integers, in place. This favours clarity. A fast
// decoder has an invocation for each lane, and sums differences with a scan.

const kInvocations = 64u;
const kBlock = 8192u;                                      // symbols of a plane in a block (7.1)
const kTotal = 4096u;                                      // of the frequencies of a table (7.2)
const kLow = 65536u;                                       // the least state (7.3)
const kKeys = 1u << 30u;                                   // keys are below (8.4)
const kBytes = 0u; const kRans = 1u;                       // coders (6.4)
const kPlain = 0u; const kDelta = 2u; const kMorton = 3u;  // predictions (8.3); 1 is zigzag

struct Unit {
  offset: u32, size: u32,     // of its first byte, in `bytes`; in bytes
  coder: u32,                 // of its streams
  symbols: u32,               // n, of each plane
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

// The block of this invocation.
var<private> lanes: u32;                           // L
var<private> x: array<u32, 32>;                    // states, by lane
var<private> next: u32; var<private> end: u32;     // offsets of the next word, and after the last

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

// Finds the states and words of a block (7.3). Returns whether they are in the unit and valid. For
// the last block, this checks the sizes of all blocks.
fn open_block(unit: Unit, block: u32, blocks: u32) -> bool {
  if (unit.size / 4u < blocks - 1u) { return false; }
  next = unit.offset + 4u * (blocks - 1u);
  var left = unit.size - 4u * (blocks - 1u); var states = 0u;  // left: bytes from `next` on
  for (var k = 0u; k <= block; k++) {
    let m = min(kBlock, unit.symbols - kBlock * k);
    lanes = 1u;
    while (256u * lanes < m) { lanes *= 2u; }  // 7.1
    if (left < 4u * lanes) { return false; }
    left -= 4u * lanes;
    var words = left / 2u;
    if (k + 1u < blocks) { words = u32_at(unit.offset + 4u * k); }
    if (words > left / 2u || (k + 1u == blocks && left % 2u != 0u)) { return false; }
    left -= 2u * words;
    states = next;
    next += 4u * lanes + 2u * words;
  }
  end = next;
  next = states + 4u * lanes;
  for (var lane = 0u; lane < lanes; lane++) {
    x[lane] = u32_at(states + 4u * lane);
    if (x[lane] < kLow) { return false; }
  }
  return true;
}

// Returns whether a block has ended correctly after its last plane (7.4).
fn is_complete() -> bool {
  var complete = next == end;
  for (var lane = 0u; lane < lanes; lane++) { complete = complete && x[lane] == kLow; }
  return complete;
}

fn next_symbol(table: u32, lane: u32) -> u32 {  // 7.4
  let entry = lookups[kTotal * table + x[lane] % kTotal];
  let f = entry / kTotal % kTotal + 1u;
  x[lane] = f * (x[lane] / kTotal) + entry % kTotal;
  if (x[lane] < kLow) {
    x[lane] = kLow * x[lane];
    if (next < end) { x[lane] += u16_at(next); }
    next += 2u;  // past `end` if words are missing
  }
  return entry >> 24u;
}

// Adds m symbols of a plane, from symbol `first` on, to the values from q[at] on: a digit above
// `shift` bits (8.1).
fn decode_digit(unit: Unit, plane: u32, first: u32, m: u32, at: u32, shift: u32) {
  var table = 0u;
  if (unit.coder == kRans) { table = tables[unit.plane + plane]; }
  let constant = unit.coder == kRans && is_constant(table);
  for (var i = 0u; i < m; i++) {
    var symbol = 0u;
    if (unit.coder == kBytes) { symbol = byte_at(unit.offset + plane * unit.symbols + first + i); }
    else if (constant) { symbol = lookups[kTotal * table] >> 24u; }
    else { symbol = next_symbol(table, i % lanes); }
    q[at + i] = select(q[at + i], 0u, shift == 0u) | (symbol << shift);
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
      let digits = select(streams[s].digits, (streams[s].low + 7u) / 8u, low);
      var shift = 0u;
      for (var d = 0u; d < digits; d++) {
        decode_digit(unit, plane, first, m, at, shift);
        shift += select(streams[s].bits[d], 8u, low);
        plane += 1u;
      }
    }
  }
}

// Replaces the values of a component by integers (8.2, 8.3).
fn predict(stream: Stream, n: u32, component: u32) {
  var previous = 0u;
  for (var at = stream.at + n * component; at < stream.at + n * (component + 1u); at++) {
    if (stream.prediction != kPlain) { q[at] = (q[at] / 2u) ^ (0u - q[at] % 2u); }  // unzigzag
    if (stream.prediction == kDelta) { q[at] += previous; }
    previous = q[at];
  }
}

// As predict(), with prediction 3 (8.4). Returns whether all keys are in range.
fn predict_morton(stream: Stream, n: u32) -> bool {
  var key = stream.first_key;
  for (var i = 0u; i < n; i++) {
    let difference = q[stream.at + 3u * n + i];
    if (key >= kKeys || difference >= kKeys || key + difference >= kKeys) { return false; }
    key += difference;
    for (var c = 0u; c < 3u; c++) {
      let at = stream.at + c * n + i; var h = 0u;
      for (var j = 0u; j < 10u; j++) { h |= ((key >> (3u * j + c)) & 1u) << j; }
      q[at] = (h << stream.low) + select(q[at], 0u, stream.low == 0u);
    }
  }
  return true;
}

@compute @workgroup_size(kInvocations)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
  let u = group.x; let id = local.x;
  let unit = units[u]; let n = unit.symbols;
  let planes = stored_planes(unit);
  let blocks = n / kBlock + min(1u, n % kBlock);
  let coded = unit.coder == kRans && planes > 0u && n > 0u;
  var fits = coded || unit.size == 0u;  // Otherwise there is a byte for each symbol.
  if (!coded && planes > 0u) { fits = unit.size / planes == n && unit.size % planes == 0u; }
  if (!fits) { atomicOr(&damage[u], 1u); }
  for (var block = id; fits && block < blocks; block += kInvocations) {
    if (!coded || open_block(unit, block, blocks)) {
      decode_block(unit, block);
      if (coded && !is_complete()) { atomicOr(&damage[u], 2u); }
    } else {
      atomicOr(&damage[u], 1u);
    }
  }
  storageBarrier();
  for (var s = unit.stream; s < unit.stream + unit.streams; s++) {
    if (streams[s].prediction == kMorton) {
      if (id == 0u && !predict_morton(streams[s], n)) { atomicOr(&damage[u], 4u); }
    } else if (id < streams[s].components) {
      predict(streams[s], n, id);
    }
  }
}
