// SPDX-License-Identifier: Apache-2.0
// The summary of `stgs info`. scene_info_tables.cpp has the tables.
#include <algorithm>

#include "printable.h"
#include "scene_info.h"

namespace stgs::tools {
namespace {

constexpr int kFileSize = 106;               // issue number, spec/conformance.md
constexpr std::size_t kMaxListedParts = 10;  // without --segments

// The five lines that every file has.
std::string summary(const SceneInfo& info) {
  const stgs_scene_info& m = info.scene;
  const std::optional<double> kbps = info.mean_kbps();
  const std::string camera =
      info.start_camera ? fmt::format("{}x{}", info.start_camera->width, info.start_camera->height)
                        : "none";
  const std::uint64_t present = m.file_bytes - info.contents.missing_bytes;
  const std::string size =
      info.contents.missing_bytes == 0
          ? fmt::format("{} ({} bytes)", human_bytes(m.file_bytes), m.file_bytes)
          : fmt::format("{} of {} ({} of {} bytes)", human_bytes(present),
                        human_bytes(m.file_bytes), present, m.file_bytes);
  return fmt::format(
      "{}: STGS {}.{}, {}, {}\n"
      "  duration         {:.3f} s, {} at {:.6g} fps{}\n"
      "  primitives       {}, SH degree {}, {:.1f} bytes each\n"
      "  segments         {} in {}, head {}, decoder {}\n"
      "  start camera     {}, positions {:.4g} {:.4g} {:.4g} to {:.4g} {:.4g} {:.4g}\n",
      one_line(info.name), m.format_major, m.format_minor, info.profile, size, m.duration_seconds,
      plural(m.frames, "frame"), 1.0 / info.frame_seconds(),
      kbps ? fmt::format(", {:.0f} kbit/s", *kbps) : "", m.primitives, m.sh_degree,
      info.bytes_per_primitive(), info.count_segments(), plural(info.contents.tiers, "tier"),
      human_bytes(info.contents.head_bytes), level_text(info.decoder), camera, m.bounds_min[0],
      m.bounds_min[1], m.bounds_min[2], m.bounds_max[0], m.bounds_max[1], m.bounds_max[2]);
}

std::string metadata_text(const SceneInfo& info) {
  const stgs_scene_info& m = info.scene;
  std::string out;
  if (!info.title.empty()) out += fmt::format("  title            {}\n", one_line(info.title));
  if (!info.generator.empty()) {
    out += fmt::format("  written by       {}\n", one_line(info.generator));
  }
  out += fmt::format("  splats           {}\n",
                     m.kernel == 0 ? "dilated, as in 3DGS" : "band-limited");
  constexpr int kBt709 = 1, kSrgb = 13;
  if (m.colour_primaries != kBt709 || m.transfer_function != kSrgb) {
    out += fmt::format("  colours          primaries {}, transfer function {} (ITU-T H.273)\n",
                       m.colour_primaries, m.transfer_function);
  }
  if (m.metres_per_unit > 0) out += fmt::format("  unit             {:.6g} m\n", m.metres_per_unit);
  if (info.has_up()) {
    out += fmt::format("  up               {:.4g} {:.4g} {:.4g}, floor at {:.4g} {:.4g} {:.4g}\n",
                       m.up[0], m.up[1], m.up[2], m.floor[0], m.floor[1], m.floor[2]);
  }
  if (!info.audio.empty()) {
    out += fmt::format("  audio            {}, from {:.3f} s\n", one_line(info.audio),
                       m.audio_begin_seconds);
  }
  if (info.contents.is_window != 0) {
    const std::uint32_t first = info.contents.window_first_frame;
    out += fmt::format("  window           frames {}:{} of a capture of {}\n", first,
                       first + m.frames, info.contents.capture_frames);
  }
  return out;
}

std::string truncation_text(const SceneInfo& info) {
  if (info.contents.missing_bytes == 0) return {};
  std::size_t complete = 0, without_sh = 0;
  for (const stgs_segment& segment : info.segments) {
    const bool available = segment.available != 0, sh_available = segment.sh_available != 0;
    complete += available && sh_available ? 1 : 0;
    without_sh += available && !sh_available ? 1 : 0;
  }
  return fmt::format(
      "  truncated        {} missing; {} of {} of segments complete, {} without SH; complete up to "
      "{:.3f} s\n",
      plural(info.contents.missing_bytes, "byte"), complete, plural(info.segments.size(), "tier"),
      without_sh, info.scene.complete_seconds);
}

std::string recording_text(const SceneInfo& info) {
  const stgs_contents& contents = info.contents;
  std::string out;
  if (contents.form != STGS_FORM_FINISHED) {
    out += fmt::format(
        "  form             live recording, {}; 'stgs finalize' moves its index to the front\n",
        contents.form == STGS_FORM_RECORDED ? "closed" : "not closed yet");
  }
  if (contents.incomplete_bytes == 0) return out;
  return out + fmt::format("  incomplete       {} after its last complete fragment\n",
                           plural(contents.incomplete_bytes, "byte"));
}

std::string damage_text(const SceneInfo& info) {
  std::string out = truncation_text(info);
  for (const stgs_issue& issue : info.issues) {
    // Reported as truncated.
    if (issue.number == kFileSize && info.contents.missing_bytes > 0) continue;
    out += fmt::format("  {:<16} {} [issue {}, byte {}]\n",
                       issue.is_error != 0 ? "damaged" : "warning", issue.message, issue.number,
                       issue.offset);
  }
  for (const stgs_lost_fragment& lost : info.lost_fragments) {
    out += fmt::format("  lost             from {:.3f} s to {:.3f} s, {}\n", lost.begin_seconds,
                       lost.end_seconds, plural(lost.bytes, "byte"));
  }
  return out;
}

std::string parts_text(const SceneInfo& info) {
  if (lists_parts(info)) return part_rows(info);
  if (info.parts.size() <= 1) return {};
  return fmt::format("  parts            {} (--segments lists them)\n", info.parts.size());
}

}  // namespace

bool lists_parts(const SceneInfo& info) {
  return info.parts.size() > 1 && info.parts.size() <= kMaxListedParts;
}

std::string level_text(const stgs_decoder_needs& needs) {
  return needs.level > 0 ? fmt::format("level {}", needs.level) : "above all levels";
}

std::string info_text(const SceneInfo& info) {
  return summary(info) + metadata_text(info) + recording_text(info) + damage_text(info) +
         parts_text(info);
}

}  // namespace stgs::tools
