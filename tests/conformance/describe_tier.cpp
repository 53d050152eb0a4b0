// SPDX-License-Identifier: Apache-2.0
#include <bit>
#include <cmath>
#include <cstring>

#include "core/bytes.h"
#include "describe.h"
#include "sha256.h"
#include "stream_integers.h"

namespace stgs::testing {
namespace {

// The tier that is described.
struct Tier {
  std::string place;
  SegmentNumbers segment;
  const Gaussians4D* set = nullptr;  // as the reader decodes it
  std::set<std::size_t> ended;       // primitives
  ShMembers members;                 // primitives with SH of each degree
};

std::string hash_of(const std::vector<std::vector<std::int64_t>>& components) {
  ByteWriter out;
  for (const auto& component : components) {
    for (const std::int64_t v : component) out.u32(static_cast<std::uint32_t>(v));
  }
  return sha256(out.view());
}

void describe_stream(const Tier& tier, Attribute attribute, const StreamIntegers& stream,
                     Description& out) {
  const StreamRow& row = *stream.row;
  std::string line =
      fmt::format("attribute {} {} {} {} {} {} {} {}", tier.place, name_of(attribute),
                  stream.q[0].size(), row.mapping, row.step.multiplier, row.step.exponent,
                  bits_text(row.origin), hash_of(stream.q));
  const auto mapping = static_cast<Mapping>(row.mapping);
  if (mapping == Mapping::kDisplacement || mapping == Mapping::kShapedRotation)
    line += " " + hash_of({{stream.exponents.begin(), stream.exponents.end()}});
  if (mapping == Mapping::kTime) line += " " + stream.first;
  out.line("{}", line);
}

// Returns whether the reader's float is right for a number (spec 8.5).
bool is_right(float found, double number, const StreamRow& row) {
  if (static_cast<Mapping>(row.mapping) == Mapping::kFloat)
    return std::bit_cast<std::uint32_t>(found) ==
           std::bit_cast<std::uint32_t>(static_cast<float>(number));
  double origin = 0;
  for (const float v : row.origin) origin = std::max(origin, std::abs(double{v}));
  return std::abs(found - number) <= 0x1p-20 * (std::abs(number) + origin);
}

// Checks the reader's floats of an attribute, and describes them.
void check_floats(const Tier& tier, Attribute attribute, const StreamIntegers& stream,
                  Description& out) {
  if (attribute == Attribute::kShDegree) return;
  const AttributeView<const float> view = view_of(*tier.set, attribute);
  const int band = band_of(attribute);
  const std::size_t n = stream.q[0].size();
  std::vector<bool> has(tier.set->size(), band == 0);
  std::vector<std::size_t> primitives;
  if (band > 0) {
    for (const std::uint32_t i : tier.members[static_cast<std::size_t>(band - 1)]) has[i] = true;
  }
  for (std::size_t i = 0; i < has.size(); ++i) {
    if (has[i]) primitives.push_back(i);
  }
  if (primitives.size() != n ||
      stream.numbers.size() != static_cast<std::size_t>(components_of(attribute))) {
    return out.line("mismatch: {} has {} values", name_of(attribute), primitives.size());
  }
  // Ends change the numbers of a lifespan and the position at its centre (representation 2.7).
  const bool may_end = attribute == Attribute::kPosition || attribute == Attribute::kTime ||
                       attribute == Attribute::kRadius;
  const bool shown = out.with_floats && stream.row->mapping != 0;
  for (std::size_t c = 0; c < stream.numbers.size(); ++c) {
    std::string text;
    std::size_t wrong = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const float found = view.data[primitives[i] * view.stride + c];
      const bool is_known = !(may_end && tier.ended.contains(primitives[i]));
      if (is_known && !is_right(found, stream.numbers[c][i], *stream.row) && wrong++ == 0) {
        out.line("mismatch: {} {} of primitive {} is {}, not {}", name_of(attribute), c,
                 primitives[i], found, stream.numbers[c][i]);
      }
      if (shown) text += fmt::format(" {:.9g}", found);
    }
    for (std::size_t i = 0; i < has.size(); ++i) {
      if (!has[i] && view.data[i * view.stride + c] != 0.0f)
        out.line("mismatch: {} of primitive {} is not 0", name_of(attribute), i);
    }
    if (shown) out.line("floats {} {} {}{}", tier.place, name_of(attribute), c, text);
  }
}

// Describes the streams of one record.
void describe_record(const OpenFile& file, std::uint32_t ordinal, const SegmentRecord& record,
                     Tier& tier, Description& out) {
  Findings findings;
  RecordDecoder decoder(record, file.head, ordinal, findings);
  DecodedRows rows;
  if (!decoder.open() || !decoder.decode(kAllAttributes, rows))
    return out.line("mismatch: {}", findings.status({}).message());
  const std::vector<StreamRow>& streams = record.layout_in(*file.head.layouts).streams;
  tier.segment.first_key = record.first_key;
  RecordIntegers integers;
  for (std::size_t r = 0; r < streams.size(); ++r) {
    const StreamRow& row = streams[r];
    if (row.optional()) continue;
    const auto attribute = static_cast<Attribute>(row.attribute);
    if (attribute == Attribute::kShDegree) tier.members = rows.members;
    const int band = band_of(attribute);
    const std::size_t n = band > 0 ? record.sh[static_cast<std::size_t>(band - 1)]
                                   : file.head.index.segments[ordinal].base.primitives;
    const StreamIntegers& stream = integers[attribute] =
        integers_of(row, rows.planes[r].data(), n, tier.segment, integers);
    describe_stream(tier, attribute, stream, out);
    check_floats(tier, attribute, stream, out);
  }
}

// Checks that positions and times are the same if they are decoded alone.
void check_placement(const OpenFile& file, std::uint32_t ordinal, const Gaussians4D& set,
                     Description& out) {
  const Result<Placement> placement = file.reader->decode_placement(ordinal);
  if (!placement.ok() || placement->position != set.position || placement->time != set.time)
    out.line("mismatch: positions and times alone");
}

}  // namespace

void describe_tier(const OpenFile& file, std::uint32_t ordinal, const std::string& place,
                   Description& out) {
  const FileHead& head = file.head;
  Status sh_status;
  const Result<Gaussians4D> set = file.reader->decode_intact(ordinal, sh_status);
  if (!set.ok()) return out.refuse("tier " + place, set.status());
  const SegmentEntry& entry = head.index.segments[ordinal];
  const PartEntry& part = head.parts[entry.part];
  Tier tier;
  tier.place = place;
  tier.segment.part_units = to_units(part.end - part.begin, 20);
  tier.segment.start_units = to_units(interval_of(head, entry.base, entry.part).begin, 21);
  tier.set = &*set;
  const std::vector<SegmentEnd> ends = file.reader->ends(ordinal);
  for (const SegmentEnd& end : ends) tier.ended.insert(end.primitive);
  SegmentRecords records;
  Findings findings;
  if (!read_segment(*file.source, head, ordinal, sh_status.ok(), records, findings))
    return out.line("mismatch: {}", findings.status({}).message());
  describe_record(file, ordinal, records.base, tier, out);
  if (!records.sh.bytes.empty()) describe_record(file, ordinal, records.sh, tier, out);
  check_placement(file, ordinal, *set, out);
  if (!sh_status.ok()) out.refuse("sh " + place, sh_status);
  for (const SegmentEnd& end : ends)
    out.line("end {} {} {}", place, end.primitive, to_units(end.ticks, 20));
}

}  // namespace stgs::testing
