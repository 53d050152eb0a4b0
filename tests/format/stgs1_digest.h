// SPDX-License-Identifier: Apache-2.0
// Digests of files of format version 1.x: of their decoded data, and of the scenes read from them.
#pragma once

#include <xxhash.h>

#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "core/bytes.h"
#include "interchange/stgs1/file.h"
#include "interchange/stgs1/stgs1.h"

namespace stgs::testing {

using Stgs1Bytes = std::vector<std::uint8_t>;

inline Stgs1Bytes stgs1_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

inline std::string hash_of(std::span<const std::uint8_t> bytes) {
  return fmt::format("{:016x}", XXH3_64bits(bytes.data(), bytes.size()));
}

// Returns the hash of one attribute: all components of one primitive after the other.
inline std::string attribute_hash(const Gaussians4D& set, std::uint16_t attribute) {
  namespace v1 = stgs1;
  const FloatArray* const arrays[] = {&set.position, &set.time,         &set.sigma,
                                      &set.radius,   &set.velocity,     &set.log_scale,
                                      &set.rotation, &set.opacity_logit};
  const auto count = static_cast<std::size_t>(v1::components_of(attribute));
  const bool is_sh = attribute >= v1::kSh0;
  const std::size_t first = is_sh ? 3 * (attribute - v1::kSh0) * (attribute - v1::kSh0) : 0u;
  const std::size_t stride = is_sh ? 3 * static_cast<std::size_t>(set.sh_coefficients()) : count;
  const FloatArray& values = is_sh ? set.sh : *arrays[attribute - 1];
  ByteWriter out;
  for (std::size_t i = 0; i < set.size(); ++i) {
    for (std::size_t c = 0; c < count; ++c) out.f32(values[i * stride + first + c]);
  }
  return hash_of(out.view());
}

// The data of a file (spec/conformance.md 3.2 of format version 1.1) and the refused parts.
struct Stgs1Description {
  std::string decoded;               // hash
  std::vector<std::string> refused;  // "file", "damage", "segment 0", ...
  bool is_sh_zero = true;            // wherever the SH record is refused
};

inline Stgs1Description describe_stgs1(const Stgs1Bytes& bytes, const ReadLimits& limits) {
  const auto source = memory_source(bytes, "x.stgs");
  ImportMemory memory(limits, "file");
  stgs1::File file{*source, memory};
  Stgs1Description out;
  std::string lines;
  if (!stgs1::open_stgs1(file).ok()) return {hash_of({}), {"file"}};
  out.refused.assign(file.damage.size(), "damage");
  for (std::size_t i = 0; i < file.tiers.size(); ++i) {
    Status sh_status;
    std::vector<std::uint16_t> skipped;
    const auto set = stgs1::decode_tier(file, file.tiers[i], sh_status, skipped);
    if (!set.ok()) {
      out.refused.push_back(fmt::format("segment {}", i));
      continue;
    }
    for (std::uint16_t a = 1; a <= stgs1::kSh0 + file.degree; ++a) {
      if (a > stgs1::kSh0 && !sh_status.ok()) break;
      lines +=
          fmt::format("segment {} {} {}\n", i, stgs1::name_of(a), attribute_hash(set->value, a));
    }
    if (sh_status.ok()) continue;
    out.refused.push_back(fmt::format("segment {} sh", i));
    const std::size_t stride = 3 * static_cast<std::size_t>(set->value.sh_coefficients());
    for (std::size_t k = 0; k < set->value.sh.size(); ++k) {
      out.is_sh_zero = out.is_sh_zero && (k % stride < 3 || set->value.sh[k] == 0);
    }
  }
  const auto importance = stgs1::read_importance(file);
  if (!importance.ok()) {
    out.refused.emplace_back("importance");
  } else if (!importance->value.empty()) {
    ByteWriter values;
    for (const float v : importance->value) values.f32(v);
    lines += fmt::format("importance {}\n", hash_of(values.view()));
  }
  out.decoded = hash_of({reinterpret_cast<const std::uint8_t*>(lines.data()), lines.size()});
  return out;
}

// Returns the hash of everything in a scene but its quantisation.
inline std::string scene_digest(const Scene& scene) {
  ByteWriter out;
  const SceneMetadata& m = scene.metadata;
  for (const std::uint32_t v : {m.time_base.numerator, m.time_base.denominator, m.frames})
    out.u32(v);
  for (const float v : {m.metres_per_unit, m.near_plane}) out.f32(v);
  for (const auto* v : {&m.up, &m.floor, &m.background, &m.bounds_min, &m.bounds_max}) {
    for (const float x : *v) out.f32(x);
  }
  const StartCamera camera = m.start_camera.value_or(StartCamera{});
  for (const float v : camera.rotation) out.f32(v);
  for (const float v : camera.translation) out.f32(v);
  for (const float v : {camera.fx, camera.fy, camera.cx, camera.cy}) out.f32(v);
  for (const std::uint32_t v : {camera.width, camera.height}) out.u32(v);
  for (const std::string* v : {&m.generator, &m.title, &m.audio}) out.string(*v);
  out.f64(m.audio_begin);
  for (const std::uint8_t v : {m.kernel, std::uint8_t{0}, m.sh_convention}) out.u8(v);
  const CaptureWindow window = m.window.value_or(CaptureWindow{});
  for (const std::uint32_t v : {window.first_frame, window.capture_frames}) out.u32(v);
  for (const std::uint64_t v : {window.capture, window.training}) out.u64(v);
  for (const ScenePart& part : scene.parts) {
    const TickRange cut = part.cut.value_or(TickRange{-1, -1});
    for (const double v : {part.begin_ticks, part.end_ticks, cut.begin, cut.end}) out.f64(v);
    out.u64(part.primitives);
  }
  const Gaussians4D& set = scene.gaussians;
  out.u32(static_cast<std::uint32_t>(set.sh_degree));
  for (const FloatArray* array : {&set.position, &set.log_scale, &set.rotation, &set.opacity_logit,
                                  &set.sh, &set.time, &set.velocity, &set.sigma, &set.radius}) {
    out.u64(array->size());
    for (const float v : *array) out.f32(v);
  }
  out.u64(scene.importance.size());
  for (const float v : scene.importance) out.f32(v);
  return hash_of(out.view());
}

}  // namespace stgs::testing
