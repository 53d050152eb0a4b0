// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <stdexcept>

#include "codec/draco_points.h"
#include "codec/planes.h"
#include "container/segment.h"
#include "core/bytes.h"

namespace stgs {
namespace {

// Encodes the planes of a unit, which begin at `at`; moves `at` behind them.
std::vector<std::uint8_t> encode_unit(const Layout& layout, Layout::Unit unit,
                                      const RecordPlanes& planes, const LayoutSet& set,
                                      const std::uint8_t*& at) {
  std::vector<RansPlane> group;
  for (std::size_t i = unit.first; i < unit.first + unit.count; ++i) {
    const StreamRow& row = layout.streams[i];
    const std::size_t symbols = planes.symbols_of(static_cast<Attribute>(row.attribute));
    const std::span all(at, row.planes() * symbols);
    at += all.size();
    if (static_cast<Coder>(row.coder) == Coder::kBytes) return {all.begin(), all.end()};
    if (static_cast<Coder>(row.coder) == Coder::kDraco) return draco_encode(all, symbols);
    for (std::size_t p = 0; p < row.tables.size(); ++p) {
      const std::uint16_t table = row.tables[p];
      if (set.only[table] < 0)
        group.push_back({all.subspan(p * symbols, symbols), &set.tables[table]});
    }
  }
  if (group.empty()) return {};
  auto coded = rans_encode(group, group.front().symbols.size());
  if (!coded.ok()) throw std::runtime_error(coded.status().message());
  return std::move(*coded);
}

}  // namespace

SegmentPayload write_segment(const IndexEntry& entry, int sh_degree, const RecordPlanes& planes,
                             const RecordCoding& coding) {  // spec 6.5
  const Layout& layout = coding.set->layouts[coding.layout];
  const std::vector<Layout::Unit> units = layout.units();
  SegmentPayload out;
  out.stored.resize(layout.streams.size());
  std::vector<std::vector<std::uint8_t>> bytes;
  const std::uint8_t* at = planes.symbols.data();
  for (const Layout::Unit unit : units) {
    bytes.push_back(encode_unit(layout, unit, planes, *coding.set, at));
    if (!layout.streams[unit.first].in_group()) out.stored[unit.first] = bytes.back().size();
  }
  ByteWriter to;
  to.u16(static_cast<std::uint16_t>(entry.level));
  to.u16(entry.layer);
  to.u32(entry.slot);
  to.u32(entry.primitives);
  to.u16(coding.own ? kOwnLayout : coding.layout);
  if (coding.own) write_layouts(*coding.set, to);
  if (layout.has_sh_degree()) {
    for (int k = 0; k < sh_degree; ++k) to.u32(planes.sh[static_cast<std::size_t>(k)]);
  }
  if (layout.has_first_key()) to.u32(planes.first_key);
  for (const auto& unit : bytes) to.u32(static_cast<std::uint32_t>(unit.size()));
  for (const auto& unit : bytes) to.bytes(unit);
  out.bytes = to.take();
  // A record has a byte for each primitive (spec 5.5).
  if (content_of(entry.layer) == static_cast<int>(Content::kPrimitives))
    out.bytes.resize(std::max<std::size_t>(out.bytes.size(), planes.n));
  return out;
}

}  // namespace stgs
