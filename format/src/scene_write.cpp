// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <exception>

#include "bytes.h"
#include "draco_points.h"
#include "scene_write.h"
#include "stgs/format/output_file.h"

namespace stgs {
namespace {

constexpr int kMostTiers = 16;
constexpr float kFarthest = 0x1p99f;  // scene units

Status check_settings(const SceneMetadata& metadata, const WriteSettings& settings) {
  if (metadata.time_base.numerator == 0 || metadata.time_base.denominator == 0 ||
      metadata.frames == 0) {
    return usage_error(
        "a scene needs a time base and at least one frame (it has {} frames of {}/{} s)",
        metadata.frames, metadata.time_base.numerator, metadata.time_base.denominator);
  }
  if (!(settings.quality >= 0 && settings.quality <= 100)) {
    return usage_error("quality {} is not in 0..100", settings.quality);
  }
  if (settings.tiers < 0 || settings.tiers > kMostTiers) {
    return usage_error("{} tiers, not 1 to {}, or 0 to choose", settings.tiers, kMostTiers);
  }
  if (settings.zstd_level < 1 || settings.zstd_level > 19) {
    return usage_error("zstd level {} is not in 1..19", settings.zstd_level);
  }
  const double ticks = metadata.time_base.ticks(settings.chunk_seconds);
  if (!std::isfinite(ticks) || ticks < 0.0 || ticks > kMostChunk ||
      (ticks != 0.0 && ticks * 1e6 < metadata.frames)) {
    return usage_error("chunks of {} s do not cut a timeline of {} frames", settings.chunk_seconds,
                       metadata.frames);
  }
  return {};
}

Status check_sizes(const Scene& scene) {
  const Gaussians4D& set = scene.gaussians;
  if (set.sh_degree < 0 || set.sh_degree > 3) {
    return usage_error("harmonics of degree {}, not 0 to 3", set.sh_degree);
  }
  const std::size_t n = set.size();
  const std::size_t sh = n * 3 * static_cast<std::size_t>(set.sh_coefficients());
  const bool good = set.position.size() == 3 * n && set.log_scale.size() == 3 * n &&
                    set.rotation.size() == 4 * n && set.sh.size() == sh && set.time.size() == n &&
                    set.velocity.size() == 3 * n && set.sigma.size() == n && set.radius.size() == n;
  if (!good) return usage_error("the arrays of a set of {} primitives differ in length", n);
  if (!scene.importance.empty() && scene.importance.size() != n) {
    return usage_error("importances of {} primitives, the scene has {}", scene.importance.size(),
                       n);
  }
  if (n > 0xFFFFFFFF) return usage_error("{} primitives, more than a file's 2^32 - 1", n);
  return {};
}

Status check_parts(const Scene& scene) {
  std::uint64_t primitives = 0;
  for (const ScenePart& part : scene.parts) {
    primitives += part.primitives;
    const TickRange shown = part.shown_range();
    const double first = part.cut ? std::max(part.begin_ticks, 0.0) : part.begin_ticks;
    if (!is_moment(part.begin_ticks) || !is_moment(part.end_ticks) || !is_moment(shown.begin) ||
        !is_moment(shown.end) || part.end_ticks - part.begin_ticks > kMostChunk ||
        !(part.begin_ticks < part.end_ticks && first <= shown.begin && shown.begin < shown.end &&
          shown.end <= part.end_ticks)) {
      return usage_error(
          "a part lasts from {} to {} and is shown from {} to {}: not in order, before the "
          "timeline, too long, or no multiples of 2^-20 ticks",
          part.begin_ticks, part.end_ticks, shown.begin, shown.end);
    }
  }
  if (!scene.parts.empty() && primitives != scene.gaussians.size()) {
    return usage_error("the parts have {} primitives, the scene has {}", primitives,
                       scene.gaussians.size());
  }
  const std::optional<CaptureWindow>& window = scene.metadata.window;
  if (window &&
      std::uint64_t{window->first_frame} + scene.metadata.frames > window->capture_frames) {
    return usage_error("{} frames from frame {} on do not lie in a capture of {} frames",
                       scene.metadata.frames, window->first_frame, window->capture_frames);
  }
  return {};
}

Status check_values(const Scene& scene) {
  const Gaussians4D& set = scene.gaussians;
  for (std::size_t i = 0; i < scene.importance.size(); ++i) {
    if (scene.importance[i] >= 0.0f && std::isfinite(scene.importance[i])) continue;
    return usage_error("importance of primitive {} is {}, not a number >= 0", i,
                       scene.importance[i]);
  }
  for (Attribute attribute : attributes_of(set.sh_degree)) {
    const AttributeView<const float> view = view_of(set, attribute);
    const auto components = static_cast<std::size_t>(components_of(attribute));
    for (std::size_t i = 0; i < set.size(); ++i) {
      for (std::size_t c = 0; c < components; ++c) {
        const float v = view.data[i * view.stride + c];
        if (!std::isfinite(v)) {
          return usage_error("{}[{}] of primitive {} is {}, not a finite number",
                             name_of(attribute), c, i, v);
        }
      }
    }
  }
  for (std::size_t i = 0; i < set.size(); ++i) {
    if (!(set.sigma[i] > 0.0f)) {
      return usage_error("sigma of primitive {} is {}, not > 0", i, set.sigma[i]);
    }
    if (!(set.radius[i] >= 0.0f)) {
      return usage_error("radius of primitive {} is {}, not >= 0", i, set.radius[i]);
    }
    const float* q = set.rotation.data() + 4 * i;
    if (q[0] == 0.0f && q[1] == 0.0f && q[2] == 0.0f && q[3] == 0.0f) {
      return usage_error("rotation of primitive {} is a quaternion of length 0", i);
    }
  }
  return {};
}

// That the steps of a profile that has some reach what lies farthest out (spec 7.5).
Status check_extent(const Gaussians4D& set) {
  for (std::size_t i = 0; i < set.position.size(); ++i) {
    if (std::abs(set.position[i]) <= kFarthest) continue;
    const float* x = set.position.data() + i / 3 * 3;
    return unsupported(
        "a primitive lies at ({:g}, {:g}, {:g}), and steps reach no farther than {:g}: cut it "
        "away, "
        "or keep the scene lossless",
        x[0], x[1], x[2], kFarthest);
  }
  return {};
}

// What a reader would refuse is not written.
Status check_metadata(const FileMetadata& metadata) {
  Findings findings;
  check_metadata_values(metadata, 0, findings);
  if (findings.ok()) return {};
  return usage_error("{}", findings.take().front().message);
}

// Of the positions, widened by the error that the profile may make.
void set_bounds(const Gaussians4D& set, float margin, SceneMetadata& metadata) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    float low = set.size() == 0 ? 0.0f : INFINITY, high = set.size() == 0 ? 0.0f : -INFINITY;
    for (std::size_t i = axis; i < set.position.size(); i += 3) {
      low = std::min(low, set.position[i]);
      high = std::max(high, set.position[i]);
    }
    if (margin == 0.0f) {
      metadata.bounds_min[axis] = low;
      metadata.bounds_max[axis] = high;
      continue;
    }
    // Rounded outwards (spec 4.3).
    metadata.bounds_min[axis] = std::nextafter(low - margin, -INFINITY);
    metadata.bounds_max[axis] = std::nextafter(high + margin, INFINITY);
  }
}

// The parts as ranges of the primitives; one of all where there are none.
std::vector<PartRange> ranges_of(const Scene& scene) {
  const auto count = static_cast<std::uint32_t>(scene.gaussians.size());
  const auto frames = static_cast<double>(scene.metadata.frames);
  if (scene.parts.empty()) return {{0, count, {0.0, frames}, {}}};
  std::vector<PartRange> ranges;
  std::uint32_t first = 0;
  for (const ScenePart& part : scene.parts) {
    const auto last = static_cast<std::uint32_t>(first + part.primitives);
    ranges.push_back({first, last, {part.begin_ticks, part.end_ticks}, part.cut});
    first = last;
  }
  return ranges;
}

double longest_of(std::span<const PartRange> parts) {
  double longest = 0.0;
  for (const PartRange& part : parts) {
    longest = std::max(longest, part.length());
  }
  return longest;
}

std::vector<std::uint8_t> assemble(const FileMetadata& metadata, Body& body) {
  const std::vector<IndexEntry*> records = records_of(body.index.segments);
  std::uint64_t body_bytes = body.importance.size();
  for (const IndexEntry* record : records) body_bytes += record->bytes;
  std::vector<std::uint8_t> head_records = write_head_records(metadata, body.layouts);
  const std::vector<std::uint8_t> index =
      write_record(kIndexTag, write_index(body.index, body.parts));
  head_records.insert(head_records.end(), index.begin(), index.end());
  auto [out, copy] = write_copied_head({}, head_records, body_bytes);
  std::uint64_t at = out.size();
  for (IndexEntry* record : records) {
    record->offset = at;
    at += record->bytes;
  }
  out.resize(out.size() + body_bytes + copy.size());
  const auto place_at = [&out = out](const std::vector<std::uint8_t>& bytes, std::uint64_t offset) {
    std::copy(bytes.begin(), bytes.end(), out.begin() + static_cast<std::ptrdiff_t>(offset));
  };
  for (std::size_t s = 0; s < body.index.segments.size(); ++s) {
    place_at(body.bases[s], body.index.segments[s].base.offset);
    place_at(body.harmonics[s], body.index.segments[s].harmonics.offset);
  }
  place_at(body.importance, at);
  place_at(copy, at + body.importance.size());
  return out;
}

}  // namespace

Status check_profile(Profile profile) {
  if (profile == Profile::kUnknown)
    return usage_error("a profile that is unknown cannot be written");
  return profile == Profile::kDraco ? check_draco() : Status();
}

Status check_scene(const Scene& scene, const WriteSettings& settings) {
  STGS_TRY(check_profile(settings.profile));
  STGS_TRY(check_settings(scene.metadata, settings));
  STGS_TRY(check_sizes(scene));
  STGS_TRY(check_values(scene));
  if (settings.profile != Profile::kLossless) STGS_TRY(check_extent(scene.gaussians));
  return check_parts(scene);
}

Result<EncodedScene> encode_records(const Scene& scene, const WriteSettings& settings,
                                    double chunk_ticks) {
  EncodedScene out;
  out.metadata = {scene.metadata, settings.profile, scene.gaussians.sh_degree};
  const std::vector<PartRange> parts = ranges_of(scene);
  std::optional<Quantiser> quantiser;
  std::vector<float> importance;
  Gaussians4D snapped;
  Encoding encoding;
  encoding.set = &scene.gaussians;
  encoding.zstd_level = settings.zstd_level;
  encoding.own_layouts = settings.own_layouts;
  encoding.stop = settings.stop;
  if (settings.profile != Profile::kLossless) {
    importance = scene.importance.empty() ? importance_by_size(scene.gaussians, ticks_of(parts))
                                          : scene.importance;
    quantiser.emplace(scene.gaussians, importance, scene.importance.empty(), longest_of(parts),
                      settings.quality, settings.max_error);
    // Segments follow from what a decoder will see.
    snapped = quantiser->snap_lifespans(scene.gaussians, parts);
    encoding.set = &snapped;
    encoding.importance = importance;
    encoding.quantiser = &*quantiser;
    encoding.tiers = settings.tiers;
    encoding.draco = settings.profile == Profile::kDraco;
    encoding.coder = settings.coder == SceneCoder::kRans ? Coder::kRans : Coder::kBytes;
  }
  encoding.chunk_ticks = chunk_ticks > 0 ? chunk_ticks : choose_chunk(*encoding.set, parts);
  set_bounds(*encoding.set, quantiser ? quantiser->position_step(snapped) : 0.0f,
             out.metadata.scene);
  STGS_TRY(check_metadata(out.metadata));
  out.body = encode_body(encoding, parts);
  return out;
}

std::vector<std::uint8_t> write_head_records(const FileMetadata& metadata,
                                             const LayoutSet& layouts) {
  std::vector<std::uint8_t> out = write_record(kMetadataTag, write_metadata(metadata));
  const auto add = [&out](std::uint32_t tag, std::span<const std::uint8_t> payload,
                          std::uint32_t flags) {
    const std::vector<std::uint8_t> record = write_record(tag, payload, flags);
    out.insert(out.end(), record.begin(), record.end());
  };
  if (!layouts.layouts.empty()) {
    ByteWriter payload;
    write_layouts(layouts, payload);
    add(kLayoutTag, payload.view(), kCritical);
  }
  if (metadata.scene.window) add(kWindowTag, write_window(*metadata.scene.window), 0);
  return out;
}

Result<std::vector<std::uint8_t>> encode_scene(const Scene& scene, const WriteSettings& settings,
                                               std::vector<std::uint32_t>* order) {
  STGS_TRY(check_scene(scene, settings));
  try {
    const double chunk = to_chunk(scene.metadata.time_base.ticks(settings.chunk_seconds));
    STGS_ASSIGN(EncodedScene encoded, encode_records(scene, settings, chunk));
    Body& body = encoded.body;
    // For whoever packs it; what is packed needs it no more.
    if (settings.profile == Profile::kLossless && !scene.importance.empty()) {
      body.importance =
          write_record(kImportanceTag, write_importance(scene.importance, body.order), 0);
    }
    if (order != nullptr) *order = std::move(body.order);
    return assemble(encoded.metadata, body);
  } catch (const std::exception& e) {
    return Status(code_of(e),
                  fmt::format("cannot encode {} primitives: {}", scene.gaussians.size(), e.what()));
  }
}

Status write_scene(const std::string& path, const Scene& scene, const WriteSettings& settings) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, encode_scene(scene, settings));
  return write_file_atomically(path, bytes);
}

}  // namespace stgs
