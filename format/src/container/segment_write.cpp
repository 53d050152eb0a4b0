// SPDX-License-Identifier: Apache-2.0
#include <stdexcept>

#include "codec/draco_points.h"
#include "codec/planes.h"
#include "container/segment.h"
#include "core/bytes.h"

namespace stgs {

namespace {

// Stores the first streams raw until the record has the required number of bytes for its primitives
// (spec 5.5). Constant streams may compress too well.
void unpack_streams(const Layout& layout, const RecordPlanes& planes,
                    std::vector<std::vector<std::uint8_t>>& streams) {
  std::size_t bytes = 0;
  for (const auto& stream : streams) bytes += stream.size();
  const std::uint8_t* at = planes.symbols.data();
  for (std::size_t i = 0; i < streams.size(); ++i) {
    const std::size_t size = layout.streams[i].planes() * planes.n;
    const bool packed = static_cast<Coder>(layout.streams[i].coder) == Coder::kBytes;
    if (packed && planes.n / kMaxPrimitivesPerByte > bytes) {
      bytes += size - streams[i].size();
      streams[i].assign(at, at + size);
    }
    at += size;
  }
}

}  // namespace

SegmentPayload write_segment(const IndexEntry& entry, const RecordPlanes& planes,
                             const RecordCoding& coding) {  // spec 6.1
  const Layout& layout = coding.set->layouts[coding.layout];
  SegmentPayload out;
  std::vector<std::uint8_t> varying;  // planes that are not constant
  std::vector<std::vector<std::uint8_t>> streams;
  std::vector<RansPlane> group;
  const std::uint8_t* at = planes.symbols.data();
  for (const StreamRow& row : layout.streams) {
    const std::span all(at, row.planes() * planes.n);
    at += all.size();
    streams.emplace_back();
    if (static_cast<Coder>(row.coder) == Coder::kBytes) {
      varying.insert(varying.end(), all.begin(), all.end());
      streams.back() = compress_planes(all, planes.n, coding.zstd_level);
    } else if (static_cast<Coder>(row.coder) == Coder::kDraco) {
      varying.insert(varying.end(), all.begin(), all.end());
      streams.back() = draco_encode(all, planes.n);
    }
    for (std::size_t p = 0; p < row.tables.size(); ++p) {
      const std::uint16_t table = row.tables[p];
      if (coding.set->only[table] >= 0) continue;
      const auto plane = all.subspan(p * planes.n, planes.n);
      varying.insert(varying.end(), plane.begin(), plane.end());
      group.push_back({plane, &coding.set->tables[table]});
    }
  }
  if (!layout.has_group()) unpack_streams(layout, planes, streams);
  for (const auto& stream : streams) out.stored.push_back(stream.size());
  ByteWriter to;
  to.u16(static_cast<std::uint16_t>(entry.level));
  to.u16(entry.layer);
  to.u32(entry.slot);
  to.u32(entry.primitives);
  to.u16(coding.own ? kOwnLayout : coding.layout);
  to.u64(checksum(varying));
  if (coding.own) write_layouts(*coding.set, to);
  if (layout.has_first_key()) to.u64(planes.first_key);
  for (std::size_t i = 0; i < streams.size(); ++i) {
    if (static_cast<Coder>(layout.streams[i].coder) != Coder::kRans) to.u64(streams[i].size());
  }
  for (const auto& stream : streams) to.bytes(stream);
  if (layout.has_group()) {
    const auto coded = rans_encode(group, planes.n);
    if (!coded.ok()) throw std::runtime_error(coded.status().message());
    to.bytes(*coded);
  }
  out.bytes = to.take();
  return out;
}

}  // namespace stgs
