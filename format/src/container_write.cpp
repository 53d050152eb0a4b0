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

std::vector<std::uint8_t> write_index(const FileIndex& index) {  // spec 5.2
  ByteWriter out;
  out.f64(index.chunk_ticks);
  out.u64(index.primitives);
  out.u32(static_cast<std::uint32_t>(index.entries.size()));
  out.u32(static_cast<std::uint32_t>(index.attributes.size()));
  for (const IndexEntry& entry : index.entries) {
    out.u16(static_cast<std::uint16_t>(entry.level));
    out.u16(entry.layer);
    out.u32(entry.slot);
    out.u64(entry.offset);
    out.u64(entry.bytes);
    out.u32(entry.primitives);
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

std::uint64_t index_bytes(std::size_t segments, std::size_t attributes) {
  return 24 + std::uint64_t{28} * segments + std::uint64_t{10} * attributes;
}

}  // namespace stgs
