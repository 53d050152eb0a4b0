// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <exception>
#include <map>
#include <numeric>

#include "container/body_plan.h"
#include "core/bytes.h"
#include "quantise/step_chooser.h"
#include "scene/write.h"
#include "stgs/format/output_file.h"

namespace stgs {
namespace {

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

// A scene of a quantised profile and the steps chosen for it.
struct SteppedScene {
  std::vector<float> importance;
  std::optional<StepChooser> chooser;  // none: the steps are the scene's own
  Quantisation quantisation;
  Gaussians4D snapped;  // with the lifespans that a decoder reconstructs
};

// Chooses the steps, apart from the tiers, and rounds the lifespans, on which segments are based.
void choose_steps(const Scene& scene, const WriteSettings& settings,
                  const std::vector<PartRange>& parts, SteppedScene& out) {
  out.importance = scene.importance.empty() ? importance_by_size(scene.gaussians, ticks_of(parts))
                                            : scene.importance;
  if (uses_own_steps(scene, settings)) {
    out.quantisation = *scene.quantisation;
  } else {
    out.chooser.emplace(
        scene.gaussians, out.importance, scene.importance.empty(), longest_of(parts),
        StepGoal{settings.quality, settings.max_error, settings.profile == Profile::kNearLossless});
    out.quantisation = out.chooser->rules();
  }
  out.snapped =
      Quantiser(out.quantisation).snap_lifespans(scene.gaussians, parts, out.chooser.has_value());
}

// Chooses the tiers of the segments and their steps, unless the scene has its own.
void choose_tiers(const WriteSettings& settings, const std::vector<PartRange>& parts,
                  const Encoding& encoding, SteppedScene& stepped) {
  if (!stepped.chooser) return;
  const auto demand =
      measure_demand(parts, encoding.segments, encoding.chunk_ticks, encoding.set->size());
  set_tiers(*stepped.chooser, plan_tiers(stepped.importance, demand, settings.tiers),
            stepped.importance, stepped.quantisation);
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

Result<EncodedScene> encode_records(const Scene& scene, const WriteSettings& settings,
                                    double chunk_ticks, bool measure) {
  EncodedScene out;
  out.metadata = {scene.metadata, settings.profile, scene.gaussians.sh_degree};
  const std::vector<PartRange> parts = ranges_of(scene);
  const bool lossless = settings.profile == Profile::kLossless;
  SteppedScene stepped;
  std::optional<Quantiser> quantiser;
  Encoding encoding;
  encoding.set = &scene.gaussians;
  encoding.own_layouts = settings.own_layouts;
  encoding.stop = settings.stop;
  encoding.coder = settings.coder == SceneCoder::kRans ? Coder::kRans : Coder::kBytes;
  if (!lossless) {
    choose_steps(scene, settings, parts, stepped);
    encoding.set = &stepped.snapped;
    if (measure) encoding.source = &scene.gaussians;
    encoding.importance = stepped.importance;
    encoding.draco = settings.profile == Profile::kDraco;
  }
  encoding.chunk_ticks = chunk_ticks > 0 ? chunk_ticks : choose_chunk(*encoding.set, parts);
  for (const PartRange& part : parts) {
    encoding.segments.push_back(segments_of(*encoding.set, part, encoding.chunk_ticks, lossless));
  }
  if (!lossless) {
    choose_tiers(settings, parts, encoding, stepped);
    encoding.tiers = {stepped.quantisation.bounds, stepped.quantisation.graded};
    quantiser.emplace(stepped.quantisation);
    encoding.quantiser = &*quantiser;
  }
  set_bounds(*encoding.set, quantiser ? quantiser->position_step(stepped.snapped) : 0.0f,
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
