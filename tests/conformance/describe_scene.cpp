// SPDX-License-Identifier: Apache-2.0
#include <bit>
#include <cmath>

#include "core/bytes.h"
#include "describe.h"
#include "sha256.h"

namespace stgs::testing {
namespace {

// Returns the payload of the first STEP record of a head, which readers need not interpret.
std::span<const std::uint8_t> find_step(const FileHead& head, bool& exists) {
  for (std::uint64_t at = kHeaderBytes; at < head.bytes->size();) {
    const auto rest = std::span(*head.bytes).subspan(at);
    RecordHeader record;
    Findings ignored;
    if (!parse_record_header(rest, at, head.bytes->size(), record, ignored)) break;
    const auto payload = rest.subspan(kRecordHeaderBytes, record.length);
    exists = record.tag == kStepTag && record.flags == 0 && checksum(payload) == record.checksum;
    if (exists) return payload;
    at += kRecordHeaderBytes + record.length;
  }
  return {};
}

void describe_camera(const SceneMetadata& scene, Description& out) {
  if (!scene.start_camera) return out.line("camera 0 0");
  const StartCamera& camera = *scene.start_camera;
  out.line("camera {} {} {} {} {} {} {} {}", camera.width, camera.height,
           bits_text(camera.rotation), bits_text(camera.translation), bits_text(camera.fx),
           bits_text(camera.fy), bits_text(camera.cx), bits_text(camera.cy));
}

const char* state_of(const FileHead& head) {
  if (!head.growing()) return "finished";
  return head.closed ? "closed" : "growing";
}

}  // namespace

std::string bits_text(float value) {
  return fmt::format("{:08x}", std::bit_cast<std::uint32_t>(value));
}

std::string bits_text(double value) {
  return fmt::format("{:016x}", std::bit_cast<std::uint64_t>(value));
}

std::string bits_text(std::span<const float> values) {
  std::string out;
  for (const float value : values) out += (out.empty() ? "" : " ") + bits_text(value);
  return out;
}

std::string bytes_text(std::span<const std::uint8_t> bytes) {
  std::string out;
  for (const std::uint8_t byte : bytes) out += fmt::format("{:02x}", byte);
  return out.empty() ? "-" : out;
}

std::string bytes_text(const std::string& text) {
  return bytes_text({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

std::int64_t to_units(double ticks, int digits) {
  return static_cast<std::int64_t>(std::ldexp(ticks, digits));
}

void describe_scene(const OpenFile& file, Description& out) {
  const FileHead& head = file.head;
  const SceneMetadata& scene = head.metadata.scene;
  out.line("file {} {} {} {}", state_of(head), scene.frames, scene.time_base.numerator,
           scene.time_base.denominator);
  out.line("scene {} 0 {} {} {} {} {}", scene.kernel, scene.sh_convention, head.metadata.sh_degree,
           head.metadata.profile_number, scene.primaries, scene.transfer);
  out.line("background {}", bits_text(scene.background));
  out.line("bounds {} {}", bits_text(scene.bounds_min), bits_text(scene.bounds_max));
  out.line("near {}", bits_text(scene.near_plane));
  describe_camera(scene, out);
  out.line("texts {} {}", bytes_text(scene.generator), bytes_text(scene.title));
  out.line("world {} {} {}", bits_text(scene.metres_per_unit), bits_text(scene.up),
           bits_text(scene.floor));
  out.line("audio {} {}", bytes_text(scene.audio), bits_text(scene.audio_begin));
  if (scene.window) {
    out.line("window {} {} {} {}", scene.window->first_frame, scene.window->capture_frames,
             scene.window->capture, scene.window->training);
  }
  for (const PrivateName& name : head.private_names)
    out.line("private {} {} {}", static_cast<int>(name.kind), name.number, bytes_text(name.name));
  for (const ErrorBound& bound : head.error_bounds) {
    out.line("error {} {} {}", static_cast<int>(bound.attribute), bits_text(bound.greatest),
             bits_text(bound.rms));
  }
  bool has_step = false;
  const auto step = find_step(head, has_step);
  if (has_step) out.line("step {}", sha256(step));
  out.line("primitives {}", head.index.primitives);
}

}  // namespace stgs::testing
