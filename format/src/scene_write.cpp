// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <bit>
#include <cmath>
#include <exception>

#include "quantise.h"
#include "segment.h"
#include "segmenter.h"
#include "stgs/format/output_file.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

Status check_settings(const SceneMetadata& metadata, const WriteSettings& settings) {
  if (metadata.time_base.numerator == 0 || metadata.time_base.denominator == 0 ||
      metadata.frames == 0) {
    return usage_error(
        "a scene needs a time base and at least one frame (it has {} frames of {}/{} s)",
        metadata.frames, metadata.time_base.numerator, metadata.time_base.denominator);
  }
  if (settings.quality < 0 || settings.quality > 100) {
    return usage_error("quality {} is not in 0..100", settings.quality);
  }
  if (settings.zstd_level < 1 || settings.zstd_level > 19) {
    return usage_error("zstd level {} is not in 1..19", settings.zstd_level);
  }
  const double ticks = metadata.time_base.ticks(settings.chunk_seconds);
  if (!std::isfinite(ticks) || ticks * 1e6 < metadata.frames) {
    return usage_error("chunks of {} s do not cut a timeline of {} frames", settings.chunk_seconds,
                       metadata.frames);
  }
  return {};
}

Status check_sizes(const Gaussians4D& set) {
  if (set.sh_degree < 0 || set.sh_degree > 3) {
    return usage_error("harmonics of degree {}, not 0 to 3", set.sh_degree);
  }
  const std::size_t n = set.size();
  const std::size_t sh = n * 3 * static_cast<std::size_t>(set.sh_coefficients());
  const bool good = set.position.size() == 3 * n && set.log_scale.size() == 3 * n &&
                    set.rotation.size() == 4 * n && set.sh.size() == sh && set.time.size() == n &&
                    set.velocity.size() == 3 * n && set.sigma.size() == n && set.radius.size() == n;
  if (!good) return usage_error("the arrays of a set of {} primitives differ in length", n);
  if (n > 0xFFFFFFFF) return usage_error("{} primitives, more than a file's 2^32 - 1", n);
  return {};
}

Status check_parts(const Scene& scene) {
  std::uint64_t primitives = 0;
  for (const ScenePart& part : scene.parts) {
    primitives += part.primitives;
    if (!(part.begin_ticks >= 0.0 && part.begin_ticks < part.end_ticks &&
          part.end_ticks <= scene.metadata.frames)) {
      return usage_error("a part lasts from {} to {} of {} frames", part.begin_ticks,
                         part.end_ticks, scene.metadata.frames);
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

Status check_values(const Gaussians4D& set) {
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

// What a reader would refuse is not written.
Status check_metadata(const FileMetadata& metadata) {
  Findings findings;
  check_metadata_values(metadata, 0, findings);
  if (findings.ok()) return {};
  return usage_error("{}", findings.take().front().message);
}

Integers float_bits(const Gaussians4D& set, Attribute attribute) {
  Integers out;
  out.attribute = attribute;
  out.components = components_of(attribute);
  out.values.reserve(set.size() * static_cast<std::size_t>(out.components));
  const AttributeView<const float> view = view_of(set, attribute);
  for (std::size_t c = 0; c < static_cast<std::size_t>(out.components); ++c) {
    for (std::size_t i = 0; i < set.size(); ++i) {
      out.values.push_back(std::bit_cast<std::uint32_t>(view.data[i * view.stride + c]));
    }
  }
  return out;
}

std::vector<Integers> lossless_integers(const Gaussians4D& set) {
  std::vector<Integers> out;
  for (Attribute attribute : attributes_of(set.sh_degree))
    out.push_back(float_bits(set, attribute));
  return out;
}

// Of the positions, widened by the error that the profile may make.
void set_bounds(const Gaussians4D& set, float margin, SceneMetadata& metadata) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    float low = set.size() == 0 ? 0.0f : INFINITY, high = set.size() == 0 ? 0.0f : -INFINITY;
    for (std::size_t i = axis; i < set.position.size(); i += 3) {
      low = std::min(low, set.position[i]);
      high = std::max(high, set.position[i]);
    }
    metadata.bounds_min[axis] = low - margin;
    metadata.bounds_max[axis] = high + margin;
  }
}

struct Body {
  FileIndex index;
  std::vector<PartEntry> parts;
  std::vector<std::vector<std::uint8_t>> records;
  std::vector<std::uint32_t> order;  // index in the scene of each primitive of the file
};

// The parts as ranges of the primitives; one of all where there are none.
std::vector<PartRange> ranges_of(const Scene& scene) {
  const auto count = static_cast<std::uint32_t>(scene.gaussians.size());
  const auto frames = static_cast<double>(scene.metadata.frames);
  if (scene.parts.empty()) return {{0, count, {0.0, frames}}};
  std::vector<PartRange> ranges;
  std::uint32_t first = 0;
  for (const ScenePart& part : scene.parts) {
    const auto last = static_cast<std::uint32_t>(first + part.primitives);
    ranges.push_back({first, last, {part.begin_ticks, part.end_ticks}});
    first = last;
  }
  return ranges;
}

Body encode_body(const Gaussians4D& set, const std::vector<PartRange>& parts,
                 const std::optional<Quantiser>& quantiser, double chunk_ticks,
                 std::uint32_t frames, int zstd_level) {
  std::vector<SegmentMembers> segments;
  Body body;
  for (const PartRange& part : parts) {
    const std::vector<SegmentMembers> more =
        segments_of(set, part, chunk_ticks, frames, !quantiser.has_value());
    segments.insert(segments.end(), more.begin(), more.end());
    body.parts.push_back(
        {part.interval.begin, part.interval.end, static_cast<std::uint32_t>(more.size())});
  }
  body.index.chunk_ticks = chunk_ticks;
  body.index.entries.resize(segments.size());
  body.records.resize(segments.size());
  std::vector<std::vector<std::uint64_t>> bytes(segments.size());
  parallel_for(std::size_t{0}, segments.size(), [&](std::size_t s) {
    const Gaussians4D part = set.gather(segments[s].members);
    std::vector<std::uint32_t>& members = segments[s].members;
    std::vector<Integers> integers;
    if (quantiser) {
      std::vector<std::uint32_t> order;
      integers = quantiser->quantise(part, order);
      for (std::uint32_t& i : order) i = members[i];
      members = std::move(order);
    } else {
      integers = lossless_integers(part);
    }
    std::vector<EncodedStream> streams(integers.size());
    parallel_for(std::size_t{0}, integers.size(),
                 [&](std::size_t i) { streams[i] = encode_stream(integers[i], zstd_level); });
    for (const EncodedStream& stream : streams) bytes[s].push_back(stream.bytes.size());
    IndexEntry& entry = body.index.entries[s];
    entry.level = segments[s].place.level;
    entry.slot = segments[s].place.slot;
    entry.primitives = static_cast<std::uint32_t>(part.size());
    body.records[s] = write_record(kSegmentTag, write_segment(entry, streams));
    entry.bytes = body.records[s].size();
  });
  for (Attribute attribute : attributes_of(set.sh_degree)) {
    AttributeBytes total{static_cast<std::uint16_t>(attribute), 0};
    for (const auto& segment : bytes) total.bytes += segment[body.index.attributes.size()];
    body.index.attributes.push_back(total);
  }
  for (const SegmentMembers& segment : segments) {
    body.index.primitives += segment.members.size();
    body.order.insert(body.order.end(), segment.members.begin(), segment.members.end());
  }
  return body;
}

std::vector<std::uint8_t> assemble(const FileMetadata& metadata, Body& body) {
  std::vector<std::uint8_t> meta = write_record(kMetadataTag, write_metadata(metadata));
  const auto add = [&meta](std::uint32_t tag, const std::vector<std::uint8_t>& payload,
                           std::uint32_t flags) {
    const std::vector<std::uint8_t> record = write_record(tag, payload, flags);
    meta.insert(meta.end(), record.begin(), record.end());
  };
  const std::optional<CaptureWindow>& window = metadata.scene.window;
  const bool in_parts = body.parts.size() > 1 || body.parts[0].begin > 0.0 ||
                        body.parts[0].end < metadata.scene.frames;
  if (window) add(kWindowTag, write_window(*window), 0);
  if (in_parts) add(kPartsTag, write_parts(body.parts), kCritical);
  FileHeader header;
  header.minor = window || in_parts ? 2 : 1;  // spec 2.5
  header.head_bytes = kHeaderBytes + meta.size() + kRecordHeaderBytes +
                      index_bytes(body.index.entries.size(), body.index.attributes.size());
  header.file_bytes = header.head_bytes;
  for (IndexEntry& entry : body.index.entries) {
    entry.offset = header.file_bytes;
    header.file_bytes += entry.bytes;
  }
  std::vector<std::uint8_t> out = write_header(header);
  out.reserve(header.file_bytes);
  const auto append = [&out](const std::vector<std::uint8_t>& bytes) {
    out.insert(out.end(), bytes.begin(), bytes.end());
  };
  append(meta);
  append(write_record(kIndexTag, write_index(body.index)));
  for (const auto& record : body.records) append(record);
  return out;
}

}  // namespace

Result<std::vector<std::uint8_t>> encode_scene(const Scene& scene, const WriteSettings& settings,
                                               std::vector<std::uint32_t>* order) {
  STGS_TRY(check_settings(scene.metadata, settings));
  STGS_TRY(check_sizes(scene.gaussians));
  STGS_TRY(check_values(scene.gaussians));
  STGS_TRY(check_parts(scene));
  try {
    FileMetadata metadata{scene.metadata, settings.profile, scene.gaussians.sh_degree};
    const double chunk_ticks = scene.metadata.time_base.ticks(settings.chunk_seconds);
    std::optional<Quantiser> quantiser;
    if (settings.profile == Profile::kQuantised) {
      quantiser.emplace(scene.gaussians, scene.metadata.frames, settings.quality);
    }
    // Segments follow from what a decoder will see.
    Gaussians4D snapped;
    if (quantiser) snapped = quantiser->snap_lifespans(scene.gaussians);
    const Gaussians4D& set = quantiser ? snapped : scene.gaussians;
    set_bounds(set, quantiser ? quantiser->position_step() : 0.0f, metadata.scene);
    STGS_TRY(check_metadata(metadata));
    Body body = encode_body(set, ranges_of(scene), quantiser, chunk_ticks, scene.metadata.frames,
                            settings.zstd_level);
    if (order != nullptr) *order = std::move(body.order);
    return assemble(metadata, body);
  } catch (const std::exception& e) {
    return runtime_error("cannot encode {} primitives: {}", scene.gaussians.size(), e.what());
  }
}

Status write_scene(const std::string& path, const Scene& scene, const WriteSettings& settings) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, encode_scene(scene, settings));
  return write_file_atomically(path, bytes);
}

}  // namespace stgs
