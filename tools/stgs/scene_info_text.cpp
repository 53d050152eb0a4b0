// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "printable.h"
#include "scene_info.h"
#include "stgs/format/decoder_model.h"

namespace stgs::tools {
namespace {

constexpr int kFileSize = 106;  // issue number, spec/conformance.md
// Limit of the rows of a table in text. JSON has all rows.
constexpr std::size_t kMaxRows = 1000;
constexpr std::size_t kMaxListedParts = 10;  // without --segments

int tier_count(const SceneReader& reader) {
  int tiers = 0;
  for (const SegmentInfo& segment : reader.segments()) tiers = std::max(tiers, segment.tier + 1);
  return tiers;
}

std::string level_text(const DecoderNeeds& needs) {
  return needs.level > 0 ? fmt::format("level {}", needs.level) : "above all levels";
}

// The five lines that every file has.
std::string summary(const SceneReader& reader, const std::string& name) {
  const SceneMetadata& m = reader.metadata();
  const std::optional<double> kbps = mean_kbps(reader);
  const std::string camera =
      m.start_camera ? fmt::format("{}x{}", m.start_camera->width, m.start_camera->height) : "none";
  return fmt::format(
      "{}: STGS {}.{}, {}, {} ({} bytes)\n"
      "  duration         {:.3f} s, {} at {:.6g} fps{}\n"
      "  primitives       {}, SH degree {}, {:.1f} bytes each\n"
      "  segments         {} in {}, head {}, decoder {}\n"
      "  start camera     {}, positions {:.4g} {:.4g} {:.4g} to {:.4g} {:.4g} {:.4g}\n",
      name, reader.version_major(), reader.version_minor(), profile_name(reader.profile()),
      human_bytes(reader.file_bytes()), reader.file_bytes(), m.time_base.seconds(m.frames),
      plural(m.frames, "frame"), 1.0 / m.time_base.seconds(1),
      kbps ? fmt::format(", {:.0f} kbit/s", *kbps) : "", reader.primitives(), reader.sh_degree(),
      bytes_per_primitive(reader), reader.segments().size(), plural(tier_count(reader), "tier"),
      human_bytes(reader.head_bytes()), level_text(decoder_needs(reader)), camera, m.bounds_min[0],
      m.bounds_min[1], m.bounds_min[2], m.bounds_max[0], m.bounds_max[1], m.bounds_max[2]);
}

std::string metadata_text(const SceneReader& reader) {
  const SceneMetadata& m = reader.metadata();
  std::string out;
  if (!m.title.empty()) out += fmt::format("  title            {}\n", one_line(m.title));
  if (!m.generator.empty()) out += fmt::format("  written by       {}\n", one_line(m.generator));
  if (m.metres_per_unit > 0) out += fmt::format("  unit             {:.6g} m\n", m.metres_per_unit);
  if (has_up(m)) {
    out += fmt::format("  up               {:.4g} {:.4g} {:.4g}, floor at {:.4g} {:.4g} {:.4g}\n",
                       m.up[0], m.up[1], m.up[2], m.floor[0], m.floor[1], m.floor[2]);
  }
  if (!m.audio.empty()) {
    out += fmt::format("  audio            {}, from {:.3f} s\n", one_line(m.audio),
                       m.time_base.seconds(m.audio_begin));
  }
  if (m.window) {
    out +=
        fmt::format("  window           frames {}:{} of a capture of {}\n", m.window->first_frame,
                    m.window->first_frame + m.frames, m.window->capture_frames);
  }
  return out;
}

std::string truncation_text(const SceneReader& reader) {
  if (reader.missing_bytes() == 0) return {};
  std::size_t complete = 0, without_sh = 0;
  for (const SegmentInfo& segment : reader.segments()) {
    complete += segment.available && segment.sh_available ? 1 : 0;
    without_sh += segment.available && !segment.sh_available ? 1 : 0;
  }
  return fmt::format(
      "  truncated        {} missing; {} of {} complete, {} without SH; complete up to {:.3f} s\n",
      plural(reader.missing_bytes(), "byte"), complete, plural(reader.segments().size(), "segment"),
      without_sh, reader.metadata().time_base.seconds(reader.complete_ticks()));
}

std::string recording_text(const SceneReader& reader) {
  std::string out;
  if (reader.form() != SceneForm::kFinished) {
    out += fmt::format(
        "  form             live recording, {}; 'stgs finalize' moves its index to the front\n",
        reader.form() == SceneForm::kRecorded ? "closed" : "not closed yet");
  }
  if (reader.incomplete_bytes() == 0) return out;
  out += fmt::format("  incomplete       {} after its last complete fragment\n",
                     plural(reader.incomplete_bytes(), "byte"));
  if (reader.unreached_frames() == 0) return out;
  return out + fmt::format(
                   "  unreachable      these bytes hold frames up to {:.3f} s; a damaged record "
                   "hides the fragment that lists them\n",
                   reader.metadata().time_base.seconds(reader.unreached_frames()));
}

std::string damage_text(const SceneReader& reader) {
  const TimeBase& base = reader.metadata().time_base;
  std::string out = truncation_text(reader);
  for (const Issue& issue : reader.damage()) {
    if (issue.number == kFileSize && reader.missing_bytes() > 0) continue;  // reported as truncated
    out += fmt::format("  {:<16} {} [issue {}, byte {}]\n", issue.error ? "damaged" : "warning",
                       issue.message, issue.number, issue.offset);
  }
  for (const LostFragment& lost : reader.lost_fragments()) {
    out += fmt::format("  lost             from {:.3f} s to {:.3f} s, {}\n",
                       base.seconds(lost.range.begin), base.seconds(lost.range.end),
                       plural(lost.bytes, "byte"));
  }
  return out;
}

std::string omitted_rows(std::size_t rows, const char* noun) {
  if (rows <= kMaxRows) return {};
  return fmt::format("  and {} more {}; --format json lists all\n", rows - kMaxRows, noun);
}

std::string part_rows(const SceneReader& reader) {
  const TimeBase& base = reader.metadata().time_base;
  std::string out;
  for (std::size_t i = 0; i < std::min(reader.parts().size(), kMaxRows); ++i) {
    const ScenePart& part = reader.parts()[i];
    out += fmt::format("  part             {:.3f} s to {:.3f} s, {}\n",
                       base.seconds(part.shown_range().begin), base.seconds(part.shown_range().end),
                       plural(part.primitives, "primitive"));
  }
  return out + omitted_rows(reader.parts().size(), "parts");
}

// Parts are listed here if they are few, and else in the tables.
bool lists_parts(const SceneReader& reader) {
  return reader.parts().size() > 1 && reader.parts().size() <= kMaxListedParts;
}

std::string parts_text(const SceneReader& reader) {
  if (lists_parts(reader)) return part_rows(reader);
  if (reader.parts().size() <= 1) return {};
  return fmt::format("  parts            {} (--segments lists them)\n", reader.parts().size());
}

std::string segment_table(const SceneReader& reader) {
  const TimeBase& base = reader.metadata().time_base;
  std::string out =
      "\n  segment  level       tier      from s        to s  primitives       bytes    SH bytes\n";
  for (std::size_t i = 0; i < std::min(reader.segments().size(), kMaxRows); ++i) {
    const SegmentInfo& s = reader.segments()[i];
    out += fmt::format("  {:>7}  {:>10}  {:>4}  {:>10.3f}  {:>10.3f}  {:>10}  {:>10}  {:>10}\n", i,
                       s.level < 0 ? std::string("persistent") : std::to_string(s.level), s.tier,
                       base.seconds(s.begin_ticks), base.seconds(s.end_ticks), s.primitives,
                       s.bytes, s.sh_bytes);
  }
  return out + omitted_rows(reader.segments().size(), "segments");
}

double percent(std::uint64_t part, std::uint64_t total) {
  return total == 0 ? 0 : 100.0 * static_cast<double>(part) / static_cast<double>(total);
}

std::string layer_table(const SceneReader& reader) {
  std::string out = "\n  layer                  tier  primitives       bytes   share\n";
  for (const SceneLayer& layer : layers_of(reader)) {
    out += fmt::format("  {:<20}  {:>5}  {:>10}  {:>10}  {:4.1f} %\n", layer.content, layer.tier,
                       layer.primitives, layer.bytes, percent(layer.bytes, reader.file_bytes()));
  }
  return out;
}

std::string stream_table(const SceneReader& reader) {
  std::string out = "\n  stream                  bytes   share   of raw\n";
  for (const StreamInfo& s : reader.streams()) {
    out += fmt::format("  {:<16} {:>12}  {:4.1f} %   {:4.1f} %\n", s.name, s.bytes,
                       percent(s.bytes, reader.file_bytes()), percent(s.bytes, s.raw_bytes));
  }
  return out;
}

// Returns "1234  12.3 %", a share of the visible primitives.
std::string count_and_share(std::uint64_t count, const SceneStatistics& s) {
  return fmt::format("{:>10}  {:5.1f} %", count, percent(count, s.primitives - s.never_visible));
}

// Lists the bins from the first to the last that is not empty.
std::string to_text(const std::vector<HistogramBin>& bins, const SceneStatistics& s) {
  const auto filled = [](const HistogramBin& bin) { return bin.count > 0; };
  const auto first = std::find_if(bins.begin(), bins.end(), filled);
  const auto last = std::find_if(bins.rbegin(), bins.rend(), filled).base();
  std::string out;
  for (auto bin = first; bin < last; ++bin) {
    const std::string to = std::isfinite(bin->to) ? fmt::format("{:.4g}", bin->to) : "longer";
    out += fmt::format("  {:>10.4g}  {:>10}  {}\n", bin->from, to, count_and_share(bin->count, s));
  }
  return out;
}

}  // namespace

std::string info_text(const SceneReader& reader, const std::string& name) {
  return summary(reader, name) + metadata_text(reader) + recording_text(reader) +
         damage_text(reader) + parts_text(reader);
}

std::string tables_text(const SceneReader& reader) {
  const DecoderNeeds needs = decoder_needs(reader);
  std::string out = fmt::format(
      "  chunk            {:.4g} s (shortest segment)\n"
      "  decoder          {}: peak {} ({} in {}, {} decoded); {} to start, then {:.3g} Mbit/s and "
      "{:.3g} million primitives/s\n",
      reader.metadata().time_base.seconds(reader.chunk_ticks()), level_text(needs),
      plural(needs.primitives, "primitive"), human_bytes(needs.bytes),
      plural(needs.ranges, "range"), human_bytes(needs.decoded_bytes),
      human_bytes(needs.startup_bytes), needs.bits_per_second * 1e-6,
      needs.primitives_per_second * 1e-6);
  if (reader.parts().size() > 1 && !lists_parts(reader)) out += part_rows(reader);
  return out + segment_table(reader) + layer_table(reader) + stream_table(reader);
}

std::string statistics_text(const SceneStatistics& s) {
  return fmt::format(
      "\n  lifespan s  to          primitives (median {:.4g} s, {} never visible)\n{}"
      "  whole clip              {}\n"
      "\n  speed       to          primitives (scene units per second, median {:.4g})\n{}"
      "\n  static                  {}, moving by at most {:.3g} over the clip\n"
      "  drift                   {:.3g} scene units over the clip, mean of those of the whole "
      "clip\n",
      s.median_lifespan, s.never_visible, to_text(s.lifespans, s), count_and_share(s.whole_clip, s),
      s.median_speed, to_text(s.speeds, s), count_and_share(s.static_primitives, s), s.static_bound,
      s.whole_clip_drift);
}

}  // namespace stgs::tools
