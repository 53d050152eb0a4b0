// SPDX-License-Identifier: Apache-2.0
// Reading .ftgs.ply version 1, as documented by FreeTimeGsVanilla ("FTGS PLY, version 1"): a binary
// 3DGS PLY with a time, a duration and a velocity per vertex, in units of the clip. The settings of
// the clip are comments of the header, each a key and a value.
#include <algorithm>
#include <array>
#include <cfloat>
#include <charconv>
#include <cmath>
#include <numbers>
#include <string_view>

#include "interchange/clip_times.h"
#include "interchange/ply.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

constexpr std::size_t kFtgsBlockBytes = std::size_t{8} << 20;

// The settings of the clip.
class FtgsComments {
 public:
  FtgsComments(const std::string& file, const std::vector<std::string>& comments)
      : file_(file), comments_(comments) {}

  // Returns the value of a key; "" if the header does not state it.
  std::string_view find(std::string_view key) const {
    for (const std::string& comment : comments_) {
      const std::string_view text = comment;
      if (text.substr(0, text.find_first_of(" \t")) != key) continue;
      const std::size_t begin = std::min(text.find_first_not_of(" \t", key.size()), text.size());
      return text.substr(begin, text.find_last_not_of(" \t") + 1 - begin);
    }
    return {};
  }

  // Returns a number in [min, max].
  Result<double> number(std::string_view key, double min, double max) const {
    const std::string_view text = find(key);
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() ||
        !(value >= min && value <= max)) {
      return invalid_file("{}: PLY header: comment {}: expected a number from {} to {}, got '{}'",
                          file_, key, min, max, text);
    }
    return value;
  }
  // Returns a whole number in [min, max].
  Result<std::uint32_t> integer(std::string_view key, std::uint32_t min, std::uint32_t max) const {
    STGS_ASSIGN(const double value, number(key, min, max));
    if (value != std::floor(value)) {
      return invalid_file("{}: PLY header: comment {}: expected a whole number, got {}", file_, key,
                          value);
    }
    return static_cast<std::uint32_t>(value);
  }

 private:
  const std::string& file_;
  const std::vector<std::string>& comments_;
};

struct FtgsClip {
  std::uint32_t sh_degree = 0;
  bool moves = true;
  double min_duration = 0, opacity_floor = 0;
  std::optional<std::uint32_t> frames;
};

Result<FtgsClip> parse_clip(const std::string& file, const PlyHeader& header) {
  const FtgsComments settings(file, header.comments);
  if (const std::string_view version = settings.find("ftgs_version"); version != "1") {
    return unsupported("{}: unsupported FTGS version (expected 1, got '{}')", file, version);
  }
  if (const std::string_view units = settings.find("time_units"); units != "normalized") {
    return unsupported("{}: unsupported units of time (expected normalized, got '{}')", file,
                       units);
  }
  FtgsClip clip;
  STGS_ASSIGN(clip.sh_degree, settings.integer("sh_degree", 0, 3));
  STGS_ASSIGN(const std::uint32_t moves, settings.integer("use_velocity", 0, 1));
  clip.moves = moves == 1;
  STGS_ASSIGN(clip.min_duration, settings.number("min_duration", 1e-9, 1e9));
  STGS_ASSIGN(clip.opacity_floor, settings.number("opacity_floor", 0, 1));
  if (!settings.find("n_frames").empty()) {
    STGS_ASSIGN(clip.frames, settings.integer("n_frames", 1, 0xFFFFFFFF));
  }
  return clip;
}

// Reads time, duration and velocity of the vertices into the set, in ticks.
Status read_lifespans(const ByteSource& source, const PlyElement& vertex, const FtgsClip& clip,
                      const ClipTimes& times, ImportMemory& memory, Gaussians4D& set) {
  constexpr std::array kNames = {"time", "log_duration", "velocity_0", "velocity_1", "velocity_2"};
  std::array<const PlyProperty*, kNames.size()> properties;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    properties[k] = vertex.find(kNames[k]);
    if (properties[k] == nullptr) {
      return invalid_file("{}: vertices lack the property '{}'", source.name(), kNames[k]);
    }
  }
  const double span = times.last_tick();
  const auto stride = static_cast<std::size_t>(vertex.stride);
  const std::size_t block_size = std::max<std::size_t>(1, kFtgsBlockBytes / stride);
  STGS_ASSIGN(const Lease lease,
              memory.take(std::min(block_size, set.size()) * stride, "the vertices being read"));
  std::vector<std::uint8_t> block;
  for (std::size_t begin = 0; begin < set.size(); begin += block_size) {
    const std::size_t count = std::min(block_size, set.size() - begin);
    block.resize(count * stride);
    STGS_TRY(source.read(vertex.offset + begin * stride, block));
    for (std::size_t i = begin; i < begin + count; ++i) {
      const std::uint8_t* record = block.data() + (i - begin) * stride;
      std::array<double, kNames.size()> value;
      std::transform(properties.begin(), properties.end(), value.begin(),
                     [record](const PlyProperty* p) { return double{ply_float(record, *p)}; });
      const double duration = std::max(std::exp(value[1]), clip.min_duration);
      const double sigma = std::min(duration, kMaxClipSigma) * std::numbers::sqrt2 * span;
      // A duration that is not a number makes the primitive invalid: it is dropped.
      set.time[i] = std::isnan(value[1]) ? NAN : static_cast<float>(value[0] * span);
      set.sigma[i] = static_cast<float>(sigma);
      for (std::size_t c = 0; clip.moves && c < 3; ++c) {
        set.velocity[3 * i + c] = static_cast<float>(value[2 + c] / span);
      }
    }
  }
  return {};
}

}  // namespace

bool is_ftgs_ply(std::span<const std::uint8_t> head) {
  const std::string_view text(reinterpret_cast<const char*>(head.data()), head.size());
  return text.starts_with("ply") &&
         text.substr(0, text.find("end_header")).find("\ncomment ftgs_version") !=
             std::string_view::npos;
}

Result<Scene> read_ftgs_ply(const ByteSource& source, const ClipSettings& settings,
                            const ReadLimits& limits, ConversionNotes* notes) {
  STGS_ASSIGN(const PlyHeader header, read_ply_header(source));
  if (header.ascii) {
    return unsupported("{}: unsupported PLY format 'ascii'; use binary_little_endian",
                       source.name());
  }
  STGS_ASSIGN(const FtgsClip clip, parse_clip(source.name(), header));
  STGS_ASSIGN(const ClipTimes times, clip_times(clip.frames, {}, source.name(), settings));
  ImportMemory memory(limits, source.name());
  STGS_ASSIGN(Charged<Gaussians4D> read, read_ply_vertices(source, header, memory, notes));
  Gaussians4D& set = read.value;
  if (set.sh_degree != static_cast<int>(clip.sh_degree)) {
    return invalid_file("{}: the header states SH of degree {}, the vertices have degree {}",
                        source.name(), clip.sh_degree, set.sh_degree);
  }
  STGS_TRY(read_lifespans(source, *header.find("vertex"), clip, times, memory, set));
  drop_invalid(set, notes);
  if (clip.opacity_floor * 255 >= 1) {
    note(notes, fmt::format("primitives fade to opacity 0, not to {:.4g}", clip.opacity_floor));
  }
  return clip_scene(times, std::move(set));
}

}  // namespace stgs
