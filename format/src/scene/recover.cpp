// SPDX-License-Identifier: Apache-2.0
// Reading all segments of a file as one scene.
#include <algorithm>
#include <exception>

#include "container/container.h"
#include "scene/damage_count.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

// Memory for decoding a batch of segments, per thread.
constexpr std::uint64_t kBatchBytes = std::uint64_t{64} << 20;

// Returns the primitives that the index lists, which a damaged or false index may state wrongly.
std::uint64_t listed_primitives(const SceneReader& reader) {
  std::uint64_t count = 0;
  for (const SegmentInfo& segment : reader.segments()) count += segment.primitives;
  return count;
}

// Returns those of segments whose bytes are there, of which each primitive takes one (spec 5.5).
std::uint64_t available_primitives(const SceneReader& reader) {
  std::uint64_t count = 0;
  for (const SegmentInfo& segment : reader.segments())
    count += segment.available ? segment.primitives : 0;
  return count;
}

// Returns the memory for decoding a segment: its bytes, its floats, and planes of no more bytes
// than the floats (spec 8.1).
std::uint64_t decode_bytes(const SceneReader& reader, const SegmentInfo& segment) {
  return segment.bytes + segment.sh_bytes +
         8 * floats_per_primitive(reader.sh_degree()) * std::uint64_t{segment.primitives};
}

// Returns the memory for decoding the segment that takes most.
std::uint64_t largest_decode(const SceneReader& reader) {
  std::uint64_t largest = 0;
  for (const SegmentInfo& segment : reader.segments()) {
    if (segment.available) largest = std::max(largest, decode_bytes(reader, segment));
  }
  return largest;
}

// Returns the end of a batch of segments, at least one, that can be decoded at once.
std::size_t end_of_batch(const SceneReader& reader, std::size_t begin, std::uint64_t max_memory) {
  const std::vector<SegmentInfo>& segments = reader.segments();
  std::uint64_t left = max_memory;
  std::size_t end = begin;
  for (; end < segments.size(); ++end) {
    const std::uint64_t need = decode_bytes(reader, segments[end]);
    if (need > left && end > begin) break;
    left -= std::min(left, need);
  }
  return end;
}

// Checks that single precision is sufficient for the times of a scene's primitives, which count
// from the beginning of their part. Times that are stored as floats stay as they are.
Status check_times(const SceneReader& reader, const std::string& name) {
  constexpr double kMaxTicks = 0x1p20;
  if (reader.profile() == Profile::kLossless) return {};
  for (const SegmentInfo& segment : reader.segments()) {
    const double at = segment.begin_ticks - reader.parts()[segment.part].begin_ticks;
    if (segment.level < 0 || !segment.is_needed() || at <= kMaxTicks) continue;
    return unsupported(
        "{}: cannot be loaded as a whole: primitives are {:.0f} ticks after the beginning of their "
        "part, and single precision rounds times beyond {:.0f} ticks to multiples of 1/8 tick or "
        "more; play or render the file, which decodes it segment by segment",
        name, at, kMaxTicks);
  }
  return {};
}

// The result of decoding a segment.
struct Outcome {
  Status base, sh;
};

// Appends the intact content of all segments to `all`. `batch_memory`: for decoding. Memory for all
// is allocated once something is intact, so that it is never needed twice.
std::vector<Outcome> read_all(const SceneReader& reader, std::uint64_t batch_memory,
                              Gaussians4D& all) {
  const std::size_t count = reader.segments().size();
  const std::uint64_t batch_bytes =
      std::min(batch_memory, kBatchBytes * static_cast<std::uint64_t>(concurrency()));
  all.sh_degree = reader.sh_degree();
  std::vector<Outcome> outcomes(count);
  for (std::size_t begin = 0, end = 0; begin < count; begin = end) {
    end = end_of_batch(reader, begin, batch_bytes);
    std::vector<Gaussians4D> decoded(end - begin);
    parallel_for(begin, end, [&](std::size_t i) {
      Result<Gaussians4D> part =
          reader.decode_intact(static_cast<std::uint32_t>(i), outcomes[i].sh);
      outcomes[i].base = part.status();
      if (part.ok()) decoded[i - begin] = std::move(part).value();
    });
    for (const Gaussians4D& part : decoded) {
      if (all.size() == 0 && part.size() > 0) all.reserve(available_primitives(reader));
      all.append(part);
    }
  }
  return outcomes;
}

// Adds damaged segments to the report. Errors that are not caused by the file are returned.
Status count_outcomes(const SceneReader& reader, const std::vector<Outcome>& outcomes,
                      DamageReport& report) {
  report.total_segments = outcomes.size();
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    const SegmentInfo& segment = reader.segments()[i];
    const auto& [base, sh] = outcomes[i];
    const TickRange range = {segment.begin_ticks, segment.end_ticks};
    if (!base.ok()) {
      if (!is_damage(base.code())) return base;
      ++report.segments;
      report.primitives += segment.primitives;
      count_damage(report, range, segment.bytes + segment.sh_bytes, base);
    } else if (!sh.ok()) {
      ++report.segments_without_sh;
      count_damage(report, range, segment.sh_bytes, sh);
    }
  }
  merge_ranges(report);
  if (report.primitives > 0 && report.primitives == listed_primitives(reader)) return report.reason;
  return {};
}

// Reads the importances, unless they are damaged.
Status read_importance(const SceneReader& reader, DamageReport& report, Scene& scene) {
  Result<std::vector<float>> values = reader.importance();
  if (values.ok()) {
    scene.importance = std::move(values).value();
    if (!scene.importance.empty()) scene.quantisation = reader.quantisation();
    return {};
  }
  if (!is_damage(values.status().code())) return values.status();
  report.importance = values.status();
  return {};
}

// Removes the primitives of unreadable segments from parts and importances.
void remove_unreadable(const SceneReader& reader, const std::vector<Outcome>& outcomes,
                       Scene& scene) {
  std::vector<float> importance;
  auto next = scene.importance.begin();
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    const SegmentInfo& segment = reader.segments()[i];
    if (!outcomes[i].base.ok()) scene.parts[segment.part].primitives -= segment.primitives;
    if (scene.importance.empty()) continue;
    if (outcomes[i].base.ok()) importance.insert(importance.end(), next, next + segment.primitives);
    next += segment.primitives;
  }
  scene.importance = std::move(importance);
}

}  // namespace

Result<Scene> recover_scene(std::unique_ptr<ByteSource> source, DamageReport& report,
                            const ReadLimits& limits) {
  report = {};
  const std::string name = source->name();
  STGS_ASSIGN(const std::unique_ptr<SceneReader> reader,
              SceneReader::open(std::move(source), limits));
  return recover_scene(*reader, name, report, limits);
}

Result<Scene> recover_scene(const SceneReader& reader, const std::string& name,
                            DamageReport& report, const ReadLimits& limits) {
  report = {};
  report.damage = reader.damage();
  report.lost_fragments = reader.lost_fragments();
  report.incomplete_bytes = reader.incomplete_bytes();
  const std::uint64_t floats =
      available_primitives(reader) * 4 * floats_per_primitive(reader.sh_degree());
  const std::uint64_t bytes = floats + largest_decode(reader);
  if (bytes > limits.max_memory) {
    return unsupported("{}: {} primitives need {} bytes of memory, more than the limit of {}", name,
                       available_primitives(reader), bytes, limits.max_memory);
  }
  STGS_TRY(check_times(reader, name));
  try {
    Scene scene;
    scene.metadata = reader.metadata();
    const std::vector<Outcome> outcomes =
        read_all(reader, limits.max_memory - floats, scene.gaussians);
    STGS_TRY(count_outcomes(reader, outcomes, report));
    STGS_TRY(read_importance(reader, report, scene));
    scene.parts = reader.parts();
    if (report.segments > 0) remove_unreadable(reader, outcomes, scene);
    const ScenePart complete = {
        0, static_cast<double>(scene.metadata.frames), scene.gaussians.size(), {}};
    if (scene.parts == std::vector<ScenePart>{complete}) scene.parts.clear();
    return scene;
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: {}", name, e.what()));
  }
}

Result<Scene> recover_scene(const std::string& path, DamageReport& report,
                            const ReadLimits& limits) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(path));
  return recover_scene(std::move(source), report, limits);
}

Result<Scene> read_scene(const std::string& path, const ReadLimits& limits) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(path));
  return read_scene(std::move(source), limits);
}

Result<Scene> read_scene(std::unique_ptr<ByteSource> source, const ReadLimits& limits) {
  DamageReport report;
  STGS_ASSIGN(Scene scene, recover_scene(std::move(source), report, limits));
  STGS_TRY(report.reason);
  STGS_TRY(report.importance);
  return scene;
}

}  // namespace stgs
