// SPDX-License-Identifier: Apache-2.0
// Decodes the units of a record to the integers q of its streams (stgs-format.md 7, 8.1 to 8.4)
// with unsigned 32-bit integers alone. decode.wgsl is the same algorithm in WGSL.
//
// A workgroup decodes a unit (6.5): first block after block, from bytes to the values of 8.1, then
// stream after stream, from values to integers, in place. Each invocation is a lane of the blocks.
// This favours clarity: a fast decoder has a workgroup for each block, and sums with a scan.
#version 450
layout(local_size_x = 32) in;

const uint kLanes = 32u;                             // invocations; lanes of a long block
const uint kBlock = 8192u;                           // symbols of a plane in a block (7.1)
const uint kTotal = 4096u;                           // of the frequencies of a table (7.2)
const uint kLow = 65536u;                            // the least state (7.3)
const uint kKeys = 1u << 30u;                        // keys are below (8.4)
const uint kBytes = 0u, kRans = 1u;                  // coders (6.4)
const uint kZigzag = 1u, kDelta = 2u, kMorton = 3u;  // predictions (8.3)

struct Unit {
  uint offset, size;     // of its first byte in `bytes`; in bytes
  uint coder, symbols;   // of its streams; n of each of their planes
  uint plane, planes;    // first in `tables`, and count, including constant planes
  uint stream, streams;  // first in `streams`, and count
};
struct Stream {
  uint at;              // of q[0] of component 0 in `q`; the others follow, n each
  uint components;      // as in 8.1; with prediction 3 four: x, y, z, keys
  uint prediction;      // 8.3
  uint low, first_key;  // 8.4
  uint digits;          // d
  uint bits[8];         // of each digit
};

layout(std430, binding = 0) readonly buffer Bytes {
  uint bytes[];
};  // four in each, lowest first
// 4096 entries for each table, by slot (7.2). An entry has slot - start[s] in bits 0 to 11,
// f[s] - 1 in bits 12 to 23 and the slot's symbol s in bits 24 to 31.
layout(std430, binding = 1) readonly buffer Lookups {
  uint lookups[];
};
layout(std430, binding = 2) readonly buffer Units {
  Unit units[];
};
layout(std430, binding = 3) readonly buffer Streams {
  Stream streams[];
};
layout(std430, binding = 4) readonly buffer Tables {
  uint tables[];
};  // by plane, for coder 1
layout(std430, binding = 5) coherent buffer Integers {
  uint q[];
};  // two's complement
// By unit: 0 initially, then the failed checks. 1: sizes or states (6.4, 7.1, 7.3), 2: the end of a
// block (7.4), 4: keys (8.4). If it is not 0, the record is refused and the integers are arbitrary.
layout(std430, binding = 6) buffer Damage {
  uint damage[];
};

uint lane;       // of this invocation
uint x;          // its state
uint next, end;  // of the block's words: the offset of the next in `bytes`, and after the last
// A bit for each lane that needs a word in a step. Three take turns: one is in use, one is set to 0
// for the next step, and one may still be read by slower invocations.
shared uint needy[3];
uint turn = 0u;

uint byte_at(uint i) {
  return bytes[i / 4u] >> (8u * (i % 4u)) & 255u;
}
uint u16_at(uint i) {
  return byte_at(i) | byte_at(i + 1u) << 8u;
}
uint u32_at(uint i) {
  return u16_at(i) | u16_at(i + 2u) << 16u;
}

// Returns whether a table has one symbol: its planes are constant, and not in the group (7.2).
bool is_constant(uint table) {
  return lookups[kTotal * table] / kTotal % kTotal == kTotal - 1u;
}

// Returns the number of planes in the bytes of a unit.
uint stored_planes(Unit unit) {
  uint count = 0u;
  for (uint p = unit.plane; p < unit.plane + unit.planes; ++p) {
    if (unit.coder == kBytes || !is_constant(tables[p])) count += 1u;
  }
  return count;
}

uint lanes_of(uint m) {  // 7.1
  uint lanes = 1u;
  while (256u * lanes < m) lanes *= 2u;
  return lanes;
}

// Finds the states and words of a block (7.3). Returns whether they are in the unit. For the last
// block, this checks the sizes of all blocks.
bool open_block(Unit unit, uint block, uint blocks) {
  if (unit.size / 4u < blocks - 1u) return false;
  uint at = unit.offset + 4u * (blocks - 1u), left = unit.size - 4u * (blocks - 1u);
  for (uint k = 0u; k <= block; ++k) {
    uint lanes = lanes_of(min(kBlock, unit.symbols - kBlock * k));
    if (left < 4u * lanes) return false;
    left -= 4u * lanes;
    bool last = k + 1u == blocks;
    uint words = last ? left / 2u : u32_at(unit.offset + 4u * k);
    if (words > left / 2u || last && left % 2u != 0u) return false;
    left -= 2u * words;
    x = lane < lanes ? u32_at(at + 4u * lane) : kLow;
    next = at + 4u * lanes;
    end = next + 2u * words;
    at = end;
  }
  return true;
}

// Returns the next symbol of this lane (7.4). Lanes without a symbol in this step call it too.
uint next_symbol(uint table, bool in_step) {
  uint entry = lookups[kTotal * table + x % kTotal], f = entry / kTotal % kTotal + 1u;
  if (in_step) x = f * (x / kTotal) + entry % kTotal;
  bool needs_word = in_step && x < kLow;
  if (needs_word) atomicOr(needy[turn % 3u], 1u << lane);
  if (lane == 0u) needy[(turn + 1u) % 3u] = 0u;
  barrier();
  uint lanes = needy[turn % 3u], at = next + 2u * bitCount(lanes & (1u << lane) - 1u);
  if (needs_word) x = kLow * x + (at < end ? u16_at(at) : 0u);
  next += 2u * bitCount(lanes);  // past `end` if words are missing
  turn += 1u;
  return entry >> 24u;
}

// Adds m symbols of a plane, from v `first` on, to the values from q[at] on: a digit above
// `shift` bits (8.1).
void decode_digit(Unit unit, uint plane, uint first, uint m, uint at, uint shift) {
  uint table = unit.coder == kRans ? tables[unit.plane + plane] : 0u;
  bool constant = unit.coder == kRans && is_constant(table);
  uint lanes = lanes_of(m);
  for (uint step = 0u; lanes * step < m; ++step) {
    uint i = lanes * step + lane, v = lookups[kTotal * table] >> 24u;
    bool in_step = lane < lanes && i < m;
    if (unit.coder == kRans && !constant) v = next_symbol(table, in_step);
    if (in_step) {
      if (unit.coder == kBytes) v = byte_at(unit.offset + plane * unit.symbols + first + i);
      q[at + i] = (shift == 0u ? 0u : q[at + i]) | v << shift;
    }
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

// Replaces the values of a stream by integers (8.2 to 8.4). Returns whether all keys are in range.
bool predict(Stream stream, uint n) {
  uint end = stream.at + n * stream.components, keys = stream.at + n * 3u, key = stream.first_key;
  bool zigzag = stream.prediction == kZigzag || stream.prediction == kDelta, in_range = true;
  for (uint at = stream.at + lane; zigzag && at < end; at += kLanes) {
    q[at] = q[at] / 2u ^ (0u - q[at] % 2u);
  }
  memoryBarrierBuffer();
  barrier();
  if (stream.prediction == kDelta && lane < stream.components) {
    for (uint i = 1u; i < n; ++i) q[stream.at + n * lane + i] += q[stream.at + n * lane + i - 1u];
  }
  for (uint at = keys; stream.prediction == kMorton && lane == 0u && at < end; ++at) {
    in_range = in_range && key < kKeys && q[at] < kKeys && key + q[at] < kKeys;
    key += q[at];
    q[at] = key;
  }
  memoryBarrierBuffer();
  barrier();
  for (uint i = lane; stream.prediction == kMorton && i < 3u * n; i += kLanes) {
    uint c = i / n, at = stream.at + i, h = 0u;
    for (uint j = 0u; j < 10u; ++j) h |= (q[keys + i % n] >> (3u * j + c) & 1u) << j;
    q[at] = (h << stream.low) + (stream.low == 0u ? 0u : q[at]);
  }
  return in_range;
}

void main() {
  uint u = gl_WorkGroupID.x, failed = 0u;
  lane = gl_LocalInvocationID.x;
  Unit unit = units[u];
  uint n = unit.symbols, planes = stored_planes(unit), blocks = n / kBlock + min(1u, n % kBlock);
  bool coded = unit.coder == kRans && planes > 0u && n > 0u;
  // If not, the unit has a byte for each symbol: none with coder 1.
  bool fits =
      planes == 0u ? unit.size == 0u : coded || unit.size / planes == n && unit.size % planes == 0u;
  if (lane < 3u) needy[lane] = 0u;
  barrier();
  for (uint block = 0u; fits && block < blocks; ++block) {
    if (coded) fits = open_block(unit, block, blocks);
    if (coded && x < kLow) failed |= 1u;
    if (fits) decode_block(unit, block);
    if (coded && (next != end || x != kLow)) failed |= 2u;
  }
  memoryBarrierBuffer();
  barrier();
  for (uint s = unit.stream; s < unit.stream + unit.streams; ++s) {
    if (!predict(streams[s], n)) failed |= 4u;
  }
  if (!fits) failed |= 1u;
  if (failed != 0u) atomicOr(damage[u], failed);
}
