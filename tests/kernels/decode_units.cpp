// SPDX-License-Identifier: Apache-2.0
#include "decode_units.h"

#include <algorithm>

namespace stgs::testing {
namespace {

constexpr std::uint32_t kCoderRans = 1;  // spec 6.4

// Returns a plane that is not constant, or null.
const CodedPlane* first_coded(const CodedStream& stream) {
  const auto plane = std::find_if(stream.planes.begin(), stream.planes.end(), [](const auto& p) {
    return p.source != CodedPlane::Source::kConstant;
  });
  return plane == stream.planes.end() ? nullptr : &*plane;
}

// Returns the group with the symbols at an offset of the decoded groups, and its first symbol.
std::pair<const CodedGroup*, std::size_t> group_at(const CodedRecord& record, std::size_t offset) {
  std::size_t first = 0;
  for (const CodedGroup& group : record.groups) {
    const std::size_t size = group.tables.size() * group.symbols;
    if (offset < first + size) return {&group, first};
    first += size;
  }
  return {};
}

RansLookup constant_lookup(std::uint8_t symbol) {
  RansTable table;
  table.frequency[symbol] = kRansTotal;
  RansLookup out{};
  rans_lookup(table, out);
  return out;
}

std::size_t low_digits(const CodedStream& stream) {
  return (static_cast<std::size_t>(stream.low) + 7) / 8;
}

// spec 8.1: the values of component c of a stream whose planes are symbols by plane.
StreamIntegers values_of(std::span<const std::vector<std::uint8_t>> planes,
                         std::span<const std::uint8_t> bits, std::size_t n) {
  StreamIntegers out(n);
  int shift = 0;
  for (std::size_t d = 0; d < planes.size(); ++d) {
    for (std::size_t i = 0; i < n; ++i) out[i] |= std::uint32_t{planes[d][i]} << shift;
    shift += bits[d];
  }
  return out;
}

// spec 8.2
std::int32_t signed_of(std::uint32_t v) {
  const auto half = static_cast<std::int32_t>(v / 2);
  return v % 2 == 0 ? half : -half - 1;
}

// spec 8.3
void undo_prediction(Prediction prediction, StreamIntegers& component) {
  std::uint32_t sum = 0;
  for (std::uint32_t& v : component) {
    if (prediction == Prediction::kPlain) continue;
    const auto q = static_cast<std::uint32_t>(signed_of(v));
    sum = prediction == Prediction::kDelta ? sum + q : q;
    v = sum;
  }
}

// spec 8.4: empty if a key is out of range. `planes`: of the keys, then of the low components.
StreamIntegers undo_morton(const CodedStream& stream, std::uint32_t first_key,
                           std::span<const std::vector<std::uint8_t>> planes) {
  const std::size_t n = stream.symbols, digits = low_digits(stream);
  const StreamIntegers keys = values_of(planes.first(stream.digits), stream.digit_bits, n);
  constexpr std::uint8_t kLowBits[] = {8, 8};
  StreamIntegers out(3 * n);
  for (std::size_t c = 0; c < 3; ++c) {
    std::uint64_t key = first_key;
    const auto low = values_of(planes.subspan(stream.digits + c * digits, digits), kLowBits, n);
    for (std::size_t i = 0; i < n; ++i) {
      key += keys[i];
      if (key >= 1u << 30) return {};
      std::uint32_t high = 0;
      for (std::size_t bit = 0; bit < 10; ++bit)
        high += static_cast<std::uint32_t>(key >> (3 * bit + c) & 1) << bit;
      out[c * n + i] = high * (1u << stream.low) + low[i];
    }
  }
  return out;
}

}  // namespace

std::vector<RecordUnit> units_of(const CodedRecord& record) {
  std::vector<RecordUnit> out;
  for (const CodedStream& stream : record.streams) {
    const CodedPlane* const plane = first_coded(stream);
    const bool stored = plane != nullptr && plane->source == CodedPlane::Source::kStored;
    const CodedGroup* const group =
        plane == nullptr || stored ? nullptr : group_at(record, plane->offset).first;
    auto unit = std::find_if(out.begin(), out.end(), [&](const RecordUnit& known) {
      return group != nullptr && known.group == group;
    });
    if (unit == out.end()) {
      unit = out.insert(out.end(), RecordUnit{group, {}, {}});
      if (group != nullptr) {
        const auto* const begin = record.bytes.data() + group->offset;
        unit->bytes.assign(begin, begin + group->size);
      } else if (stored) {
        const auto* const begin = record.stored.data() + plane->offset;
        unit->bytes.assign(begin, begin + stream.planes.size() * stream.symbols);
      }
    }
    unit->streams.push_back(&stream);
  }
  return out;
}

std::uint32_t ShaderBuffers::table(const RansLookup& lookup) {
  const auto [entry, added] =
      numbers_.try_emplace(lookup, static_cast<std::uint32_t>(lookups.size()));
  if (added) lookups.push_back(lookup);
  return entry->second;
}

void ShaderBuffers::add(const RecordUnit& unit, std::span<const RansLookup> record_lookups,
                        std::uint32_t first_key) {
  ShaderUnit out;
  out.offset = static_cast<std::uint32_t>(bytes.size());
  out.size = static_cast<std::uint32_t>(unit.bytes.size());
  out.symbols = unit.streams.front()->symbols;
  out.coder = kCoderRans;
  out.plane = static_cast<std::uint32_t>(tables.size());
  out.stream = static_cast<std::uint32_t>(streams.size());
  out.streams = static_cast<std::uint32_t>(unit.streams.size());
  bytes.insert(bytes.end(), unit.bytes.begin(), unit.bytes.end());
  std::size_t coded = 0;  // planes of the group so far
  for (const CodedStream* stream : unit.streams) {
    for (const CodedPlane& plane : stream->planes) {
      if (plane.source == CodedPlane::Source::kStored) out.coder = 0;
      tables.push_back(plane.source == CodedPlane::Source::kGroup
                           ? table(record_lookups[unit.group->tables[coded++]])
                       : plane.source == CodedPlane::Source::kConstant
                           ? table(constant_lookup(plane.only))
                           : 0);
    }
    const bool morton = stream->prediction == Prediction::kMorton;
    ShaderStream row;
    row.at = integers;
    row.components = morton ? 4 : static_cast<std::uint32_t>(stream->components);
    row.prediction = static_cast<std::uint32_t>(stream->prediction);
    row.low = static_cast<std::uint32_t>(stream->low);
    row.first_key = first_key;
    row.digits = static_cast<std::uint32_t>(stream->digits);
    std::copy(stream->digit_bits.begin(), stream->digit_bits.end(), row.bits);
    integers += row.components * stream->symbols;
    streams.push_back(row);
  }
  out.planes = static_cast<std::uint32_t>(tables.size()) - out.plane;
  units.push_back(out);
}

std::vector<StreamIntegers> scalar_integers(const RecordUnit& unit, const CodedRecord& record,
                                            std::span<const RansLookup> lookups,
                                            std::uint32_t first_key) {
  const std::size_t n = unit.streams.front()->symbols;
  std::vector<std::uint8_t> decoded;
  std::size_t first = 0;  // of `decoded`, in the decoded groups
  if (unit.group != nullptr) {
    auto group = RansGroupDecoder::open(unit.bytes, n);
    if (!group.ok()) return {};
    decoded.resize(n * unit.group->tables.size());
    std::uint8_t* at = decoded.data();
    for (const std::uint16_t table : unit.group->tables) {
      group->next_plane(lookups[table], at);
      at += n;
    }
    if (!group->finish()) return {};
    for (const CodedGroup& other : record.groups) {
      if (&other == unit.group) break;
      first += other.tables.size() * other.symbols;
    }
  }
  std::vector<StreamIntegers> out;
  for (const CodedStream* stream : unit.streams) {
    std::vector<std::vector<std::uint8_t>> planes;
    for (const CodedPlane& plane : stream->planes) {
      std::vector<std::uint8_t>& symbols = planes.emplace_back(n, plane.only);
      const std::uint8_t* const from = plane.source == CodedPlane::Source::kGroup
                                           ? decoded.data() + (plane.offset - first)
                                           : record.stored.data() + plane.offset;
      if (plane.source != CodedPlane::Source::kConstant) std::copy_n(from, n, symbols.begin());
    }
    StreamIntegers& q = out.emplace_back();
    if (stream->prediction == Prediction::kMorton) {
      q = undo_morton(*stream, first_key, planes);
      if (q.empty()) return {};
      continue;
    }
    for (std::size_t c = 0; c < stream->components; ++c) {
      StreamIntegers component = values_of(
          std::span(planes).subspan(c * stream->digits, stream->digits), stream->digit_bits, n);
      undo_prediction(stream->prediction, component);
      q.insert(q.end(), component.begin(), component.end());
    }
  }
  return out;
}

}  // namespace stgs::testing
