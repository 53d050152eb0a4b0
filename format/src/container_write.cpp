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
  out.u8(scene.kernel);
  out.u8(0);  // axes: OpenCV
  out.u8(scene.colour);
  out.u8(scene.harmonics);
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
  out.f32(scene.metres_per_unit);
  for (float v : scene.up) out.f32(v);
  for (float v : scene.floor) out.f32(v);
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

}  // namespace stgs
