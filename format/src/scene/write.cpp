// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <exception>

#include "codec/draco_points.h"
#include "core/bytes.h"
#include "scene/write.h"
#include "stgs/format/output_file.h"

namespace stgs {
namespace {

constexpr float kFarthest = 0x1p99f;  // scene units

Status check_settings(const SceneMetadata& metadata, const WriteSettings& settings) {
  if (metadata.time_base.numerator == 0 || metadata.time_base.denominator == 0 ||
      metadata.frames == 0) {
    return usage_error(
        "invalid duration: a scene needs a time base and at least one frame (got {} frames of "
        "{}/{} "
        "s)",
        metadata.frames, metadata.time_base.numerator, metadata.time_base.denominator);
  }
  STGS_TRY(check_parameter(kQuality, settings.quality));
  STGS_TRY(check_parameter(kTiers, settings.tiers));
  const double ticks = metadata.time_base.ticks(settings.chunk_seconds);
  if (!std::isfinite(ticks) || ticks < 0.0 || ticks > kMaxChunk ||
      (ticks != 0.0 && ticks * 1e6 < metadata.frames)) {
    return usage_error("invalid chunk length of {} s for a timeline of {} frames",
                       settings.chunk_seconds, metadata.frames);
  }
  return {};
}

Status check_sizes(const Scene& scene) {
  const Gaussians4D& set = scene.gaussians;
  if (set.sh_degree < 0 || set.sh_degree > 3) {
    return usage_error("invalid SH degree (expected 0 to 3, got {})", set.sh_degree);
  }
  const std::size_t n = set.size();
  const std::size_t sh = n * 3 * static_cast<std::size_t>(set.sh_coefficients());
  const bool good = set.position.size() == 3 * n && set.log_scale.size() == 3 * n &&
                    set.rotation.size() == 4 * n && set.sh.size() == sh && set.time.size() == n &&
                    set.velocity.size() == 3 * n && set.sigma.size() == n && set.radius.size() == n;
  if (!good) return usage_error("array lengths do not match (for {} primitives)", n);
  if (!scene.importance.empty() && scene.importance.size() != n) {
    return usage_error("number of importances does not match (expected {}, got {})", n,
                       scene.importance.size());
  }
  if (n > 0xFFFFFFFF) return usage_error("too many primitives (at most 2^32 - 1, got {})", n);
  return {};
}

Status check_quantisation(const Scene& scene) {
  if (!scene.quantisation) return {};
  if (scene.importance.empty()) return usage_error("the steps of a scene need importances");
  if (is_valid(*scene.quantisation)) return {};
  return usage_error("the steps of the scene are out of range");
}

Status check_parts(const Scene& scene) {
  std::uint64_t primitives = 0;
  for (const ScenePart& part : scene.parts) {
    primitives += part.primitives;
    const TickRange shown = part.shown_range();
    const double first = part.cut ? std::max(part.begin_ticks, 0.0) : part.begin_ticks;
    if (!is_valid_time(part.begin_ticks) || !is_valid_time(part.end_ticks) ||
        !is_valid_time(shown.begin) || !is_valid_time(shown.end) ||
        part.end_ticks - part.begin_ticks > kMaxChunk ||
        !(part.begin_ticks < part.end_ticks && first <= shown.begin && shown.begin < shown.end &&
          shown.end <= part.end_ticks)) {
      return usage_error(
          "invalid part (ticks {} to {}, shown from {} to {}): ranges must be in order, not before "
          "the timeline, at most 2^32 ticks long and multiples of 2^-20 ticks",
          part.begin_ticks, part.end_ticks, shown.begin, shown.end);
    }
  }
  if (!scene.parts.empty() && primitives != scene.gaussians.size()) {
    return usage_error("the parts do not cover all primitives (expected {}, got {})",
                       scene.gaussians.size(), primitives);
  }
  const std::optional<CaptureWindow>& window = scene.metadata.window;
  if (window &&
      std::uint64_t{window->first_frame} + scene.metadata.frames > window->capture_frames) {
    return usage_error("window of {} frames from frame {} exceeds the capture of {} frames",
                       scene.metadata.frames, window->first_frame, window->capture_frames);
  }
  return {};
}

Status check_values(const Scene& scene) {
  const Gaussians4D& set = scene.gaussians;
  for (std::size_t i = 0; i < scene.importance.size(); ++i) {
    if (scene.importance[i] >= 0.0f && std::isfinite(scene.importance[i])) continue;
    return usage_error("invalid importance of primitive {} (expected a number >= 0, got {})", i,
                       scene.importance[i]);
  }
  for (Attribute attribute : attributes_of(set.sh_degree)) {
    const AttributeView<const float> view = view_of(set, attribute);
    const auto components = static_cast<std::size_t>(components_of(attribute));
    for (std::size_t i = 0; i < set.size(); ++i) {
      for (std::size_t c = 0; c < components; ++c) {
        const float v = view.data[i * view.stride + c];
        if (!std::isfinite(v)) {
          return usage_error("invalid {}[{}] of primitive {} (expected a finite number, got {})",
                             name_of(attribute), c, i, v);
        }
      }
    }
  }
  for (std::size_t i = 0; i < set.size(); ++i) {
    if (!(set.sigma[i] > 0.0f)) {
      return usage_error("invalid sigma of primitive {} (expected > 0, got {})", i, set.sigma[i]);
    }
    if (!(set.radius[i] >= 0.0f)) {
      return usage_error("invalid radius of primitive {} (expected >= 0, got {})", i,
                         set.radius[i]);
    }
    const float* q = set.rotation.data() + 4 * i;
    if (q[0] == 0.0f && q[1] == 0.0f && q[2] == 0.0f && q[3] == 0.0f) {
      return usage_error("invalid rotation of primitive {} (quaternion of length 0)", i);
    }
  }
  return {};
}

// Checks that the steps of a quantised profile can represent the farthest position (spec 7.5).
Status check_extent(const Gaussians4D& set) {
  for (std::size_t i = 0; i < set.position.size(); ++i) {
    if (std::abs(set.position[i]) <= kFarthest) continue;
    const float* x = set.position.data() + i / 3 * 3;
    return unsupported(
        "position ({:g}, {:g}, {:g}) exceeds the quantised range of {:g}; remove the primitive or "
        "use the lossless profile",
        x[0], x[1], x[2], kFarthest);
  }
  return {};
}

// Checks metadata as a reader does.
Status check_metadata(const FileMetadata& metadata) {
  Findings findings;
  check_metadata_values(metadata, 0, findings);
  if (findings.ok()) return {};
  return usage_error("{}", findings.take().front().message);
}

// Sets the bounds of the positions, widened by the quantisation error of the profile.
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

// Returns the parts as ranges of primitives; a single range if there are no parts.
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

// Returns whether a scene is packed with the steps that it was trained for.
bool uses_own_steps(const Scene& scene, const WriteSettings& settings) {
  return scene.quantisation && settings.own_steps && !scene.importance.empty() &&
         settings.max_error == 0.0 && settings.tiers == 0;
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
  const auto copy_to = [&out = out](const std::vector<std::uint8_t>& bytes, std::uint64_t offset) {
    std::copy(bytes.begin(), bytes.end(), out.begin() + static_cast<std::ptrdiff_t>(offset));
  };
  for (std::size_t s = 0; s < body.index.segments.size(); ++s) {
    copy_to(body.bases[s], body.index.segments[s].base.offset);
    copy_to(body.sh[s], body.index.segments[s].sh.offset);
  }
  copy_to(body.importance, at);
  copy_to(copy, at + body.importance.size());
  return out;
}

}  // namespace

Status check_profile(Profile profile) {
  if (profile == Profile::kUnknown) return usage_error("cannot write an unknown profile");
  return profile == Profile::kDraco ? check_draco() : Status();
}

Status check_scene(const Scene& scene, const WriteSettings& settings) {
  STGS_TRY(check_profile(settings.profile));
  STGS_TRY(check_settings(scene.metadata, settings));
  STGS_TRY(check_sizes(scene));
  STGS_TRY(check_values(scene));
  STGS_TRY(check_quantisation(scene));
  if (settings.profile != Profile::kLossless) STGS_TRY(check_extent(scene.gaussians));
  return check_parts(scene);
}

Result<EncodedScene> encode_records(const Scene& scene, const WriteSettings& settings,
                                    double chunk_ticks) {
  EncodedScene out;
  out.metadata = {scene.metadata, settings.profile, scene.gaussians.sh_degree};
  const std::vector<PartRange> parts = ranges_of(scene);
  const bool lossless = settings.profile == Profile::kLossless;
  std::vector<float> importance;
  std::optional<StepChooser> chooser;
  Quantisation quantisation;
  std::optional<Quantiser> quantiser;
  Gaussians4D snapped;
  Encoding encoding;
  encoding.set = &scene.gaussians;
  encoding.own_layouts = settings.own_layouts;
  encoding.stop = settings.stop;
  encoding.coder = settings.coder == SceneCoder::kRans ? Coder::kRans : Coder::kBytes;
  if (!lossless) {
    importance = scene.importance.empty() ? importance_by_size(scene.gaussians, ticks_of(parts))
                                          : scene.importance;
    if (uses_own_steps(scene, settings)) {
      quantisation = *scene.quantisation;
    } else {
      chooser.emplace(scene.gaussians, importance, scene.importance.empty(), longest_of(parts),
                      settings.quality, settings.max_error);
      quantisation = chooser->rules();
    }
    // Segments are based on the values that a decoder reconstructs.
    snapped = Quantiser(quantisation).snap_lifespans(scene.gaussians, parts, chooser.has_value());
    encoding.set = &snapped;
    encoding.importance = importance;
    encoding.draco = settings.profile == Profile::kDraco;
  }
  encoding.chunk_ticks = chunk_ticks > 0 ? chunk_ticks : choose_chunk(*encoding.set, parts);
  for (const PartRange& part : parts) {
    encoding.segments.push_back(segments_of(*encoding.set, part, encoding.chunk_ticks, lossless));
  }
  if (chooser) {
    set_tiers(*chooser,
              plan_tiers(importance,
                         measure_demand(parts, encoding.segments, encoding.chunk_ticks,
                                        encoding.set->size()),
                         settings.tiers),
              importance, quantisation);
  }
  if (!lossless) {
    encoding.tiers = {quantisation.bounds, quantisation.graded};
    quantiser.emplace(quantisation);
    encoding.quantiser = &*quantiser;
  }
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
    // Needed for packing the scene later; quantised scenes do not need it.
    if (settings.profile == Profile::kLossless && !scene.importance.empty()) {
      body.importance =
          write_record(kImportanceTag, write_importance(scene.importance, body.order), 0);
      if (scene.quantisation) {
        const std::vector<std::uint8_t> rules =
            write_record(kQuantisationTag, write_quantisation(*scene.quantisation), 0);
        body.importance.insert(body.importance.end(), rules.begin(), rules.end());
      }
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
