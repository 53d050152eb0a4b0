// SPDX-License-Identifier: Apache-2.0
#include <xxhash.h>

#include "bytes.h"
#include "container.h"

namespace stgs {

std::uint64_t checksum(std::span<const std::uint8_t> bytes) {
  return XXH3_64bits(bytes.data(), bytes.size());
}

std::vector<std::uint8_t> write_header(const FileHeader& header) {  // spec 2.2
  ByteWriter out;
  out.bytes(kMagic);
  out.u16(header.major);
  out.u16(header.minor);
  out.u32(header.flags);
  out.u64(header.file_bytes);
  out.u64(header.head_bytes);
  out.u64(checksum(out.view()));
  return out.take();
}

std::vector<std::uint8_t> write_record(std::uint32_t tag, std::span<const std::uint8_t> payload,
                                       std::uint32_t flags) {
  ByteWriter out;  // spec 3.1
  out.u32(tag);
  out.u32(flags);
  out.u64(payload.size());
  out.u64(checksum(payload));
  out.u64(checksum(out.view()));
  out.bytes(payload);
  return out.take();
}

std::vector<std::uint8_t> write_metadata(const FileMetadata& metadata) {  // spec 4.2
  const SceneMetadata& scene = metadata.scene;
  ByteWriter out;
  out.u32(scene.time_base.numerator);
  out.u32(scene.time_base.denominator);
  out.u32(scene.frames);
  out.u8(scene.metric ? 1 : 0);
  out.u8(0);  // axes: OpenCV
  out.u8(0);  // colour: sRGB-encoded
  out.u8(0);  // harmonics: 3DGS
  out.u16(static_cast<std::uint16_t>(metadata.profile));
  out.u16(static_cast<std::uint16_t>(metadata.sh_degree));
  for (float v : scene.background) out.f32(v);
  for (float v : scene.bounds_min) out.f32(v);
  for (float v : scene.bounds_max) out.f32(v);
  out.f32(scene.near_plane);
  const StartCamera camera = scene.start_camera.value_or(StartCamera{});
  out.u32(camera.width);
  out.u32(camera.height);
  for (float v : camera.rotation) out.f32(v);
  for (float v : camera.translation) out.f32(v);
  for (float v : {camera.fx, camera.fy, camera.cx, camera.cy}) out.f32(v);
  out.string(scene.generator);
  out.string(scene.title);
  return out.take();
}

std::vector<IndexEntry*> records_of(std::vector<SegmentEntry>& segments) {
  std::vector<IndexEntry*> records;
  for (std::size_t begin = 0; begin < segments.size();) {
    const SegmentEntry& first = segments[begin];
    std::size_t end = begin;
    for (; end < segments.size(); ++end) {
      const SegmentEntry& segment = segments[end];
      if (segment.part != first.part || segment.base.level != first.base.level ||
          segment.base.slot != first.base.slot) {
        break;
      }
      records.push_back(&segments[end].base);
    }
    for (; begin < end; ++begin) {
      if (segments[begin].harmonics.bytes > 0) records.push_back(&segments[begin].harmonics);
    }
  }
  return records;
}

std::vector<std::uint8_t> write_index(FileIndex& index) {  // spec 5.2
  const std::vector<IndexEntry*> records = records_of(index.segments);
  ByteWriter out;
  out.f64(index.chunk_ticks);
  out.u64(index.primitives);
  out.u32(static_cast<std::uint32_t>(records.size()));
  out.u32(static_cast<std::uint32_t>(index.attributes.size()));
  for (const IndexEntry* record : records) {
    out.u16(static_cast<std::uint16_t>(record->level));
    out.u16(record->layer);
    out.u32(record->slot);
    out.u64(record->offset);
    out.u64(record->bytes);
    out.u32(record->primitives);
  }
  for (const AttributeBytes& attribute : index.attributes) {
    out.u16(attribute.attribute);
    out.u64(attribute.bytes);
  }
  return out.take();
}

std::vector<std::uint8_t> write_parts(std::span<const PartEntry> parts) {  // spec 5.10
  ByteWriter out;
  out.u32(static_cast<std::uint32_t>(parts.size()));
  for (const PartEntry& part : parts) {
    out.f64(part.begin);
    out.f64(part.end);
    out.u32(part.segments);
  }
  return out.take();
}

std::vector<std::uint8_t> write_window(const CaptureWindow& window) {  // spec 4.5
  ByteWriter out;
  out.u32(window.first_frame);
  out.u32(window.capture_frames);
  out.u64(window.capture);
  out.u64(window.training);
  return out.take();
}

std::vector<std::uint8_t> write_importance(std::span<const float> importance,
                                           std::span<const std::uint32_t> order) {  // spec 5.11
  ByteWriter out;
  for (const std::uint32_t i : order) out.f32(importance[i]);
  return out.take();
}

std::uint64_t index_bytes(std::size_t records, std::size_t attributes) {
  return 24 + std::uint64_t{28} * records + std::uint64_t{10} * attributes;
}

}  // namespace stgs
