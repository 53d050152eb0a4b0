// SPDX-License-Identifier: Apache-2.0
// Decodes the units of a record to the integers q of its streams (stgs-format.md 7, 8.1 to 8.4)
// with unsigned 32-bit integers alone. decode.wgsl is the same algorithm in WGSL.
//
// A workgroup decodes a unit (6.5): first each invocation takes blocks, from bytes to the values of
// 8.1, then each takes a component, from values to integers, in place. This favours clarity. A fast
// decoder has an invocation for each lane, and sums differences with a scan.
#version 450
layout(local_size_x = 64) in;

const uint kBlock = 8192u;                          // symbols of a plane in a block (7.1)
const uint kTotal = 4096u;                          // of the frequencies of a table (7.2)
const uint kLow = 65536u;                           // the least state (7.3)
const uint kKeys = 1u << 30u;                       // keys are below (8.4)
const uint kBytes = 0u, kRans = 1u;                 // coders (6.4)
const uint kPlain = 0u, kDelta = 2u, kMorton = 3u;  // predictions (8.3); otherwise 1, zigzag

struct Unit {
  uint offset;           // of its first byte, in `bytes`
  uint size;             // in bytes
  uint coder;            // of its streams
  uint symbols;          // n, of each plane
  uint plane, planes;    // the first in `tables`, and their count, with those that are constant
  uint stream, streams;  // the first in `streams`, and their count
};
struct Stream {
  uint at;              // of q[0] of component 0 in `q`; the others follow, n integers each
  uint components;      // as in 8.1; with prediction 3 four: x, y, z, keys
  uint prediction;      // 8.3
  uint low, first_key;  // 8.4
  uint digits;          // d
  uint bits[8];         // of each digit
};

layout(std430, binding = 0) readonly buffer Bytes { uint bytes[]; };  // four in each, lowest first
// 4096 entries for each table, by slot (7.2). An entry has slot - start[s] in bits 0 to 11,
// f[s] - 1 in bits 12 to 23 and the slot's symbol s in bits 24 to 31.
layout(std430, binding = 1) readonly buffer Lookups { uint lookups[]; };
layout(std430, binding = 2) readonly buffer Units { Unit units[]; };
layout(std430, binding = 3) readonly buffer Streams { Stream streams[]; };
layout(std430, binding = 4) readonly buffer Tables { uint tables[]; };  // by plane, for coder 1
layout(std430, binding = 5) coherent buffer Integers { uint q[]; };  // two's complement
// By unit: 0 initially, then the failed checks. 1: sizes or states (6.4, 7.1, 7.3), 2: the end of a
// block (7.4), 4: keys (8.4). If it is not 0, the record is refused and the integers are arbitrary.
layout(std430, binding = 6) buffer Damage { uint damage[]; };

// The block of this invocation.
uint lanes;      // L
uint x[32];      // states, by lane
uint next, end;  // of its words: the offset of the next in `bytes`, and the offset after the last

uint byte_at(uint i) { return bytes[i / 4u] >> (8u * (i % 4u)) & 255u; }
uint u16_at(uint i) { return byte_at(i) | byte_at(i + 1u) << 8u; }
uint u32_at(uint i) { return u16_at(i) | u16_at(i + 2u) << 16u; }

// Returns whether a table has one symbol: its planes are constant, and not in the group (7.2).
bool is_constant(uint table) { return lookups[kTotal * table] / kTotal % kTotal == kTotal - 1u; }

// Returns the number of planes in the bytes of a unit.
uint stored_planes(Unit unit) {
  uint count = 0u;
  for (uint p = unit.plane; p < unit.plane + unit.planes; ++p) {
    if (unit.coder == kBytes || !is_constant(tables[p])) count += 1u;
  }
  return count;
}

// Finds the states and words of a block (7.3). Returns whether they are in the unit and valid. For
// the last block, this checks the sizes of all blocks.
bool open_block(Unit unit, uint block, uint blocks) {
  if (unit.size / 4u < blocks - 1u) return false;
  next = unit.offset + 4u * (blocks - 1u);
  uint left = unit.size - 4u * (blocks - 1u), states = 0u;  // left: bytes from `next` on
  for (uint k = 0u; k <= block; ++k) {
    uint m = min(kBlock, unit.symbols - kBlock * k);
    lanes = 1u;
    while (256u * lanes < m) lanes *= 2u;  // 7.1
    if (left < 4u * lanes) return false;
    left -= 4u * lanes;
    bool last = k + 1u == blocks;
    uint words = last ? left / 2u : u32_at(unit.offset + 4u * k);
    if (words > left / 2u || last && left % 2u != 0u) return false;
    left -= 2u * words;
    states = next;
    next += 4u * lanes + 2u * words;
  }
  end = next;
  next = states + 4u * lanes;
  for (uint lane = 0u; lane < lanes; ++lane) {
    x[lane] = u32_at(states + 4u * lane);
    if (x[lane] < kLow) return false;
  }
  return true;
}

// Returns whether a block has ended correctly after its last plane (7.4).
bool is_complete() {
  bool complete = next == end;
  for (uint lane = 0u; lane < lanes; ++lane) complete = complete && x[lane] == kLow;
  return complete;
}

uint next_symbol(uint table, uint lane) {  // 7.4
  uint entry = lookups[kTotal * table + x[lane] % kTotal];
  uint f = entry / kTotal % kTotal + 1u;
  x[lane] = f * (x[lane] / kTotal) + entry % kTotal;
  if (x[lane] < kLow) {
    x[lane] = kLow * x[lane] + (next < end ? u16_at(next) : 0u);
    next += 2u;  // past `end` if words are missing
  }
  return entry >> 24u;
}

// Adds m symbols of a plane, from symbol `first` on, to the values from q[at] on: a digit above
// `shift` bits (8.1).
void decode_digit(Unit unit, uint plane, uint first, uint m, uint at, uint shift) {
  uint table = unit.coder == kRans ? tables[unit.plane + plane] : 0u;
  bool constant = unit.coder == kRans && is_constant(table);
  for (uint i = 0u; i < m; ++i) {
    uint symbol;
    if (unit.coder == kBytes) symbol = byte_at(unit.offset + plane * unit.symbols + first + i);
    else if (constant) symbol = lookups[kTotal * table] >> 24u;
    else symbol = next_symbol(table, i % lanes);
    q[at + i] = (shift == 0u ? 0u : q[at + i]) | symbol << shift;
  }
}

// Decodes the symbols of a block, plane after plane, to values (8.1, 8.4).
void decode_block(Unit unit, uint block) {
  uint n = unit.symbols, first = kBlock * block, m = min(kBlock, n - first), plane = 0u;
  for (uint s = unit.stream; s < unit.stream + unit.streams; ++s) {
    bool morton = streams[s].prediction == kMorton;
    for (uint c = 0u; c < streams[s].components; ++c) {
      bool low = morton && c > 0u;
      uint component = morton ? (c + 3u) % 4u : c;  // the planes of the keys are the first
      uint at = streams[s].at + n * component + first;
      uint digits = low ? (streams[s].low + 7u) / 8u : streams[s].digits, shift = 0u;
      for (uint d = 0u; d < digits; ++d) {
        decode_digit(unit, plane, first, m, at, shift);
        shift += low ? 8u : streams[s].bits[d];
        plane += 1u;
      }
    }
  }
}

// Replaces the values of a component by integers (8.2, 8.3).
void predict(Stream stream, uint n, uint component) {
  uint previous = 0u;
  for (uint at = stream.at + n * component; at < stream.at + n * (component + 1u); ++at) {
    if (stream.prediction != kPlain) q[at] = q[at] / 2u ^ (0u - q[at] % 2u);  // unzigzag
    if (stream.prediction == kDelta) q[at] += previous;
    previous = q[at];
  }
}

// As predict(), with prediction 3 (8.4). Returns whether all keys are in range.
bool predict_morton(Stream stream, uint n) {
  uint key = stream.first_key;
  for (uint i = 0u; i < n; ++i) {
    uint difference = q[stream.at + 3u * n + i];
    if (key >= kKeys || difference >= kKeys || key + difference >= kKeys) return false;
    key += difference;
    for (uint c = 0u; c < 3u; ++c) {
      uint at = stream.at + c * n + i, h = 0u;
      for (uint j = 0u; j < 10u; ++j) h |= (key >> (3u * j + c) & 1u) << j;
      q[at] = (h << stream.low) + (stream.low == 0u ? 0u : q[at]);
    }
  }
  return true;
}

void main() {
  uint u = gl_WorkGroupID.x, id = gl_LocalInvocationID.x;
  Unit unit = units[u];
  uint n = unit.symbols, planes = stored_planes(unit);
  uint blocks = n / kBlock + min(1u, n % kBlock);
  bool coded = unit.coder == kRans && planes > 0u && n > 0u;
  // If not, the unit has a byte for each symbol: none with coder 1.
  bool fits = planes == 0u ? unit.size == 0u
                           : coded || unit.size / planes == n && unit.size % planes == 0u;
  if (!fits) atomicOr(damage[u], 1u);
  for (uint block = id; fits && block < blocks; block += gl_WorkGroupSize.x) {
    if (!coded || open_block(unit, block, blocks)) {
      decode_block(unit, block);
      if (coded && !is_complete()) atomicOr(damage[u], 2u);
    } else {
      atomicOr(damage[u], 1u);
    }
  }
  memoryBarrierBuffer();
  barrier();
  for (uint s = unit.stream; s < unit.stream + unit.streams; ++s) {
    if (streams[s].prediction == kMorton) {
      if (id == 0u && !predict_morton(streams[s], n)) atomicOr(damage[u], 4u);
    } else if (id < streams[s].components) {
      predict(streams[s], n, id);
    }
  }
}
