// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <exception>
#include <map>
#include <numeric>

#include "codec/draco_points.h"
#include "container/body_plan.h"
#include "core/bytes.h"
#include "quantise/step_chooser.h"
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
  if (set.time_origin != 0) {
    return usage_error("times must count from the beginning of their parts (got an origin of {})",
                       set.time_origin);
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
    TickRange displayed = part.displayed_range();
    if (!part.cut) displayed.begin = std::max(displayed.begin, 0.0);
    if (!is_valid_part({0, part.begin_ticks, part.end_ticks, displayed, 0})) {
      return usage_error(
          "invalid part (ticks {} to {}, displayed from {} to {}): ranges must be in order, not "
          "before "
          "the timeline, at most 2^32 ticks long and multiples of 2^-20 ticks",
          part.begin_ticks, part.end_ticks, displayed.begin, displayed.end);
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

// Checks that the steps of a quantised profile can represent the farthest position (spec 8.5).
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
         settings.max_error == 0.0 && settings.tiers == 0 &&
         settings.profile != Profile::kNearLossless;
}

// Returns the primitives of all segments in this order, as indices in the scene.
std::vector<std::uint32_t> order_by(const Body& body, const std::vector<std::size_t>& segments) {
  std::vector<std::size_t> first(body.index.segments.size());
  for (std::size_t s = 0, at = 0; s < first.size(); ++s) {
    first[s] = at;
    at += body.index.segments[s].base.primitives;
  }
  std::vector<std::uint32_t> order;
  for (const std::size_t s : segments) {
    const auto begin = body.order.begin() + static_cast<std::ptrdiff_t>(first[s]);
    order.insert(order.end(), begin, begin + body.index.segments[s].base.primitives);
  }
  return order;
}

// Returns the segments by the offsets of their records.
std::vector<std::size_t> by_offset(const FileIndex& index) {
  std::vector<std::size_t> order(index.segments.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&index](std::size_t a, std::size_t b) {
    return index.segments[a].base.offset < index.segments[b].base.offset;
  });
  return order;
}

// Writes a finished file. Sets body.order to the order in which a reader returns the primitives.
std::vector<std::uint8_t> assemble(const FileMetadata& metadata, const Scene& scene, Body& body) {
  // Needed for packing the scene later; quantised scenes do not need it.
  const bool packable = metadata.profile == Profile::kLossless && !scene.importance.empty();
  const std::uint64_t other_bytes = packable ? kRecordHeaderBytes + 4 * scene.importance.size() : 0;
  std::vector<ErrorBound> errors;
  if (metadata.profile != Profile::kLossless) errors = body.errors.bounds(metadata.sh_degree);
  std::vector<std::uint8_t> records = write_head_records(
      metadata, body.layouts, packable ? scene.quantisation : std::nullopt, errors);
  const BodyPlan plan(body.index, body.parts, metadata.scene.frames, kHeaderBytes + records.size(),
                      other_bytes);
  const std::vector<std::uint8_t> index = plan.index_record();
  records.insert(records.end(), index.begin(), index.end());
  std::vector<std::uint8_t> out = write_finished_head({}, records, plan.end());
  const std::vector<std::uint8_t> copy = write_head_copy(out);
  out.resize(plan.end());
  const auto put = [&out](const std::vector<std::uint8_t>& bytes, std::uint64_t offset) {
    std::copy(bytes.begin(), bytes.end(), out.begin() + static_cast<std::ptrdiff_t>(offset));
  };
  for (const BodyPlan::Piece& piece : plan.pieces()) put(piece.page, piece.offset);
  for (std::size_t s = 0; s < body.index.segments.size(); ++s) {
    put(body.bases[s], body.index.segments[s].base.offset);
    put(body.sh[s], body.index.segments[s].sh.offset);
  }
  const std::vector<std::size_t> stored = by_offset(body.index);
  if (packable) {
    put(write_record(kImportanceTag, write_importance(scene.importance, order_by(body, stored)), 0),
        plan.others_at());
  }
  out.insert(out.end(), copy.begin(), copy.end());
  // A reader returns part after part, by the offset of the first record.
  std::vector<std::vector<std::size_t>> parts;
  std::map<std::uint32_t, std::size_t> known;
  for (const std::size_t s : stored) {
    const auto [part, is_new] = known.try_emplace(body.index.segments[s].part, parts.size());
    if (is_new) parts.emplace_back();
    parts[part->second].push_back(s);
  }
  std::vector<std::size_t> read;
  for (const auto& part : parts) read.insert(read.end(), part.begin(), part.end());
  body.order = order_by(body, read);
  return out;
}

}  // namespace

Status check_profile(Profile profile) {
  if (profile == Profile::kUnknown)
    return usage_error("cannot write the profile {}", profile_name(profile));
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
                                    double chunk_ticks, bool measure) {
  EncodedScene out;
  out.metadata = {scene.metadata, settings.profile, scene.gaussians.sh_degree};
  const std::vector<PartRange> parts = ranges_of(scene);
  const bool lossless = settings.profile == Profile::kLossless;
  const bool near_lossless = settings.profile == Profile::kNearLossless;
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
                      StepGoal{settings.quality, settings.max_error, near_lossless});
      quantisation = chooser->rules();
    }
    // Segments are based on the values that a decoder reconstructs.
    snapped = Quantiser(quantisation).snap_lifespans(scene.gaussians, parts, chooser.has_value());
    encoding.set = &snapped;
    if (measure) encoding.source = &scene.gaussians;
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

std::vector<std::uint8_t> write_head_records(const FileMetadata& metadata, const LayoutSet& layouts,
                                             const std::optional<Quantisation>& steps,
                                             std::span<const ErrorBound> errors) {
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
  if (steps) add(kStepTag, write_steps(*steps), 0);
  if (!errors.empty()) add(kErrorTag, write_error_bounds(errors), 0);
  return out;
}

Result<std::vector<std::uint8_t>> encode_scene(const Scene& scene, const WriteSettings& settings,
                                               std::vector<std::uint32_t>* order) {
  STGS_TRY(check_scene(scene, settings));
  try {
    const double chunk = to_chunk(scene.metadata.time_base.ticks(settings.chunk_seconds));
    STGS_ASSIGN(EncodedScene encoded, encode_records(scene, settings, chunk, true));
    std::vector<std::uint8_t> bytes = assemble(encoded.metadata, scene, encoded.body);
    if (order != nullptr) *order = std::move(encoded.body.order);
    return bytes;
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
