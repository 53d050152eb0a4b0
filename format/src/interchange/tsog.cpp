// SPDX-License-Identifier: Apache-2.0
// Reading .tsog version 4 (Gmira et al. 2026), as specified by OpsiClear-4DGS ("TSOG Playback
// Profile 1"): a SOG bundle with frames, or with velocities and lifespans in units of the clip.
#include <algorithm>
#include <cfloat>
#include <cmath>
#include <numbers>

#include "interchange/clip_times.h"
#include "interchange/import.h"
#include "interchange/json_fields.h"
#include "interchange/sog_decoder.h"

namespace stgs {
namespace {

using nlohmann::json;

enum class TsogTimeline { kStatic, kFrames, kContinuous };

struct TsogMeta {
  SogLayout layout;
  TsogTimeline timeline = TsogTimeline::kStatic;
  std::uint32_t frames = 1, step = 1;              // kFrames: their number, and codes per frame
  std::array<double, 2> time_mins{}, time_maxs{};  // kContinuous: centre and deviation, clips
  std::vector<std::string> time_files;             // low byte, high byte
  std::optional<SogRange> motion;                  // scene units per clip
  std::optional<double> duration, fps;             // seconds at normal speed, Hz
  double rate = 1;
  bool audio = false;
};

Status parse_timeline(const json& timeline, const std::string& label, TsogMeta& meta) {
  if (timeline.is_null()) return {};
  STGS_ASSIGN(meta.time_files, sog_files(timeline, 2, label));
  const json& type = member(timeline, "type");
  if (type == 0) {
    meta.timeline = TsogTimeline::kFrames;
    STGS_ASSIGN(const std::uint64_t frames,
                sog_integer(member(timeline, "N"), 1, 65536, label + ".N"));
    const std::uint64_t step = 65536 / frames;
    STGS_TRY(sog_integer(member(timeline, "delta"), step, step, label + ".delta").status());
    meta.frames = static_cast<std::uint32_t>(frames);
    meta.step = static_cast<std::uint32_t>(step);
    return {};
  }
  if (type != 1) {
    return unsupported("{}.type: expected 0 (frames) or 1 (continuous), got {}", label,
                       short_json(type));
  }
  meta.timeline = TsogTimeline::kContinuous;
  STGS_ASSIGN(const auto mins, number_list(member(timeline, "mins"), 2, label + ".mins"));
  STGS_ASSIGN(const auto maxs, number_list(member(timeline, "maxs"), 2, label + ".maxs"));
  std::copy_n(mins.begin(), 2, meta.time_mins.begin());
  std::copy_n(maxs.begin(), 2, meta.time_maxs.begin());
  if (!(static_cast<float>(mins[1]) > 0) || maxs[1] < mins[1]) {
    return invalid_file("{}: the standard deviations are not positive ({} to {})", label, mins[1],
                        maxs[1]);
  }
  return {};
}

Status parse_tsog_motion(const json& temporal, const std::string& label, TsogMeta& meta) {
  if (temporal.is_null()) return {};
  if (meta.timeline == TsogTimeline::kStatic) return invalid_file("{}: without a timeline", label);
  if (!temporal.is_object()) return invalid_file("{}: expected an object", label);
  for (const auto& [name, value] : temporal.items()) {
    if (name != "means") return unsupported("{}.{}: only motion is supported", label, name);
  }
  const json& means = member(temporal, "means");
  const json &mins = member(means, "mins"), &maxs = member(means, "maxs");
  const json& files = member(means, "files");
  if (!mins.is_array() || !maxs.is_array() || mins.size() != maxs.size() || mins.empty()) {
    return invalid_file("{}.means: expected mins and maxs of equal length", label);
  }
  if (mins.size() > 1) {
    return unsupported("{}.means: motion of order {} (only order 1 is supported)", label,
                       mins.size());
  }
  const std::size_t bytes = files.is_array() && files.size() == 1 ? 1 : 2;
  STGS_ASSIGN(meta.motion, sog_range_of(mins[0], maxs[0], files, bytes, label + ".means"));
  return {};
}

// Returns an optional number in [min, max].
Result<std::optional<double>> optional_number(const json& value, double min, double max,
                                              const std::string& label) {
  if (value.is_null()) return std::optional<double>();
  STGS_ASSIGN(const double number, sog_number(value, label));
  if (!(number >= min && number <= max)) {
    return invalid_file("{}: expected {} to {}, got {}", label, min, max, number);
  }
  return std::optional<double>(number);
}

Status parse_playback(const json& root, const std::string& label, TsogMeta& meta) {
  const json& playback = member(root, "playback");
  STGS_ASSIGN(meta.duration, optional_number(member(playback, "duration"), 1e-6, 1e9,
                                             label + ": playback.duration"));
  STGS_ASSIGN(meta.fps,
              optional_number(member(playback, "fps"), 0.001, 1e6, label + ": playback.fps"));
  if (!meta.fps) {
    STGS_ASSIGN(meta.fps, optional_number(member(root, "fps"), 0.001, 1e6, label + ": fps"));
  }
  STGS_ASSIGN(const auto rate,
              optional_number(member(playback, "rate"), 0.25, 4, label + ": playback.rate"));
  meta.rate = rate.value_or(1);
  meta.audio = member(root, "audio").is_object();
  return {};
}

Result<TsogMeta> parse_tsog_meta(std::span<const std::uint8_t> text, const std::string& label,
                                 ImportMemory& memory) {
  STGS_ASSIGN(const Charged<json> parsed, parse_json(text, label, memory));
  const json& root = parsed.value;
  if (const json& version = member(root, "version"); version != 4) {
    return unsupported("{}: unsupported .tsog version (expected 4, got {})", label,
                       short_json(version));
  }
  if (root.contains("profile")) {
    const json& profile = member(root, "profile");
    if (member(profile, "id") != "org.opsiclear.tsog-playback" || member(profile, "version") != 1) {
      return unsupported("{}: unsupported .tsog profile {} version {}", label,
                         short_json(member(profile, "id")), short_json(member(profile, "version")));
    }
  }
  TsogMeta meta;
  STGS_ASSIGN(meta.layout, sog_layout(root, CodebookRule::kShort, label, memory.limits()));
  STGS_TRY(parse_timeline(member(root, "timeline"), label + ": timeline", meta));
  STGS_TRY(parse_tsog_motion(member(root, "temporal"), label + ": temporal", meta));
  STGS_TRY(parse_playback(root, label, meta));
  return meta;
}

// Returns the frames and the time base of the scene.
Result<ClipTimes> times_of(const TsogMeta& meta, const std::string& path,
                           const ClipSettings& settings) {
  if (meta.timeline == TsogTimeline::kStatic) {
    if (settings.frames || settings.frame_time) {
      return usage_error("{}: a static model has no frames; omit the frame count and rate", path);
    }
    return ClipTimes{1, {1, 30}};
  }
  std::optional<double> fps = meta.fps;
  std::optional<std::uint32_t> frames;
  if (meta.timeline == TsogTimeline::kFrames) {
    frames = meta.frames;
    if (meta.duration) fps = meta.frames / *meta.duration;
  } else if (meta.duration) {
    // The first frame is at 0 and the last one at the end.
    const double intervals = std::max(1.0, std::floor(*meta.duration * fps.value_or(30) + 0.5));
    if (intervals > 0xFFFFFFFE) {
      return unsupported("{}: a clip of {} s at {} fps has too many frames", path, *meta.duration,
                         fps.value_or(30));
    }
    frames = static_cast<std::uint32_t>(intervals) + 1;
    fps = intervals / *meta.duration;
  }
  if (fps && !(*fps >= 0.001 && *fps <= 1e6)) {
    return unsupported("{}: a frame rate of {} fps (expected 0.001 to 1000000)", path, *fps);
  }
  return clip_times(frames, fps, path, settings);
}

// Reads the 16-bit codes of the timeline.
Status read_timeline(SogDecoder& decoder, const TsogMeta& meta, const ClipTimes& times,
                     Gaussians4D& set) {
  STGS_ASSIGN(const ImageRgba low, decoder.splat_image(meta.time_files[0]));
  STGS_ASSIGN(const ImageRgba high, decoder.splat_image(meta.time_files[1]));
  const double span = times.last_tick();
  const auto code = [&](std::size_t i, std::size_t channel) {
    return low.pixel(i)[channel] | std::uint32_t{high.pixel(i)[channel]} << 8;
  };
  const auto value = [&](std::size_t i, std::size_t channel) {
    const double min = meta.time_mins[channel], max = meta.time_maxs[channel];
    return min + (max - min) * code(i, channel) / 65535;
  };
  decoder.each([&](std::size_t i) {
    if (meta.timeline == TsogTimeline::kFrames) {
      const std::uint32_t frame = std::min(meta.frames - 1, code(i, 0) / meta.step);
      set_single_frame(set, i, frame, meta.frames);
      return;
    }
    const double sigma = value(i, 1) * std::numbers::sqrt2 * span;
    set.time[i] = static_cast<float>(value(i, 0) * span);
    set.sigma[i] =
        static_cast<float>(std::clamp(sigma, double{FLT_MIN}, kMaxClipSigma * (span + 1)));
  });
  return {};
}

Status read_motion(SogDecoder& decoder, const SogRange& motion, const ClipTimes& times,
                   Gaussians4D& set) {
  STGS_ASSIGN(const ImageRgba low, decoder.splat_image(motion.files[0]));
  const bool is_wide = motion.files.size() == 2;
  ImageRgba high;
  if (is_wide) {
    STGS_ASSIGN(high, decoder.splat_image(motion.files[1]));
  }
  decoder.each([&](std::size_t i) {
    for (std::size_t c = 0; c < 3; ++c) {
      const double code = low.pixel(i)[c] + (is_wide ? 256.0 * high.pixel(i)[c] : 0.0);
      const double share = code / (is_wide ? 65535 : 255);
      const double velocity = motion.mins[c] + (motion.maxs[c] - motion.mins[c]) * share;
      set.velocity[3 * i + c] = static_cast<float>(velocity / times.last_tick());
    }
  });
  return {};
}

}  // namespace

Result<Scene> read_tsog(const std::string& path, const ClipSettings& settings,
                        const ReadLimits& limits, ConversionNotes* notes) {
  ImportMemory memory(limits, path);
  STGS_ASSIGN(const std::unique_ptr<NamedFiles> files, zip_files(path, memory));
  STGS_ASSIGN(ChargedBytes text, files->read("meta.json", memory, kMaxSogMetaBytes));
  STGS_ASSIGN(const TsogMeta meta, parse_tsog_meta(text.value, files->label("meta.json"), memory));
  text = {};
  STGS_ASSIGN(const ClipTimes times, times_of(meta, path, settings));
  const std::size_t count = meta.layout.count;
  STGS_TRY(check_sog_count(*files, meta.layout, count, "", memory));
  Gaussians4D set;
  set.sh_degree = meta.layout.sh_degree();
  STGS_ASSIGN(const Lease lease, memory.take_set(count, set.sh_degree));
  set.resize(count);
  ImageRgba centroids;
  if (meta.layout.palette) {
    STGS_ASSIGN(centroids, sog_centroids(*files, *meta.layout.palette, memory));
  }
  SogDecoder decoder(*files, meta.layout, &centroids, memory, set.size());
  STGS_TRY(decoder.read_into(set, 0));
  if (meta.timeline == TsogTimeline::kStatic) {
    set_static_lifespan(set);
  } else {
    STGS_TRY(read_timeline(decoder, meta, times, set));
  }
  if (meta.motion && meta.timeline == TsogTimeline::kContinuous) {
    STGS_TRY(read_motion(decoder, *meta.motion, times, set));
  }
  drop_invalid(set, notes);
  if (meta.audio) note(notes, "the audio track is not converted");
  if (meta.rate != 1) note(notes, fmt::format("the playback rate {} is not converted", meta.rate));
  return clip_scene(times, std::move(set));
}

}  // namespace stgs
