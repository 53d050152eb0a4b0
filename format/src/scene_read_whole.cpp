// SPDX-License-Identifier: Apache-2.0
// All segments of a file as one scene.
#include <algorithm>
#include <exception>

#include "container.h"
#include "lost_records.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

// What a batch of segments takes while it is decoded, for each thread.
constexpr std::uint64_t kBatchBytes = std::uint64_t{64} << 20;

// The segments from `begin` on that decoding at once takes less than the limit for, at least one:
// their bytes, their floats, and planes of no more bytes than these (spec 7.3).
std::size_t end_of_batch(const SceneReader& reader, std::size_t begin, std::uint64_t max_memory) {
  const std::vector<SegmentInfo>& segments = reader.segments();
  std::uint64_t left = max_memory;
  std::size_t end = begin;
  for (; end < segments.size(); ++end) {
    const std::uint64_t need =
        segments[end].bytes + segments[end].sh_bytes +
        8 * floats_per_primitive(reader.sh_degree()) * std::uint64_t{segments[end].primitives};
    if (need > left && end > begin) break;
    left -= std::min(left, need);
  }
  return end;
}

// How decoding a segment ended.
struct Outcome {
  Status base, harmonics;
};

// Appends to `whole` what of the segments is sound. Memory is taken for what has been decoded, not
// for what an index says (spec 5.5).
std::vector<Outcome> read_all(const SceneReader& reader, std::uint64_t max_memory,
                              Gaussians4D& whole) {
  const std::size_t count = reader.segments().size();
  const std::uint64_t most =
      std::min(max_memory, kBatchBytes * static_cast<std::uint64_t>(concurrency()));
  whole.sh_degree = reader.sh_degree();
  std::vector<Outcome> outcomes(count);
  for (std::size_t begin = 0, end = 0; begin < count; begin = end) {
    end = end_of_batch(reader, begin, most);
    std::vector<Gaussians4D> decoded(end - begin);
    parallel_for(begin, end, [&](std::size_t i) {
      Result<Gaussians4D> part =
          reader.decode_intact(static_cast<std::uint32_t>(i), outcomes[i].harmonics);
      outcomes[i].base = part.status();
      if (part.ok()) decoded[i - begin] = std::move(part).value();
    });
    std::size_t need = whole.size();
    for (const Gaussians4D& part : decoded) need += part.size();
    // Doubled, but for the last time.
    if (need > whole.position.capacity() / 3) {
      whole.reserve(std::clamp<std::uint64_t>(2 * whole.size(), need, reader.primitives()));
    }
    for (const Gaussians4D& part : decoded) whole.append(part);
  }
  return outcomes;
}

bool is_of_the_file(const Status& status) {
  return status.code() == StatusCode::kInvalidFile || status.code() == StatusCode::kUnsupported;
}

// Counts what is lost of the segments; an error that is not the file's ends the reading.
Status count_outcomes(const SceneReader& reader, const std::vector<Outcome>& outcomes,
                      DamageReport& losses) {
  losses.total_segments = outcomes.size();
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    const SegmentInfo& segment = reader.segments()[i];
    const auto& [base, harmonics] = outcomes[i];
    const TickRange moments = {segment.begin_ticks, segment.end_ticks};
    if (!base.ok()) {
      if (!is_of_the_file(base)) return base;
      ++losses.segments;
      losses.primitives += segment.primitives;
      count_lost(losses, moments, segment.bytes + segment.sh_bytes, base);
    } else if (!harmonics.ok()) {
      ++losses.segments_without_sh;
      count_lost(losses, moments, segment.sh_bytes, harmonics);
    }
  }
  join_moments(losses);
  if (losses.primitives > 0 && losses.primitives == reader.primitives()) return losses.reason;
  return {};
}

// The importances, where there is nothing wrong with them.
Status read_importance(const SceneReader& reader, DamageReport& losses, Scene& scene) {
  Result<std::vector<float>> values = reader.importance();
  if (values.ok()) {
    scene.importance = std::move(values).value();
    return {};
  }
  if (!is_of_the_file(values.status())) return values.status();
  losses.importance = values.status();
  return {};
}

// Takes lost segments, whose primitives are not there, out of parts and importances.
void leave_out(const SceneReader& reader, const std::vector<Outcome>& outcomes, Scene& scene) {
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

Result<Scene> recover_scene(std::unique_ptr<ByteSource> source, DamageReport& losses,
                            const ReadLimits& limits) {
  losses = {};
  const std::string path = source->name();
  STGS_ASSIGN(const std::unique_ptr<SceneReader> reader,
              SceneReader::open(std::move(source), limits));
  losses.damage = reader->damage();
  losses.lost_fragments = reader->lost_fragments();
  losses.incomplete_bytes = reader->incomplete_bytes();
  losses.unreached_frames = reader->unreached_frames();
  const std::uint64_t bytes = reader->primitives() * 4 * floats_per_primitive(reader->sh_degree());
  if (bytes > limits.max_memory) {
    return unsupported("{}: {} primitives need {} bytes of memory, more than the limit of {}", path,
                       reader->primitives(), bytes, limits.max_memory);
  }
  try {
    Scene scene;
    scene.metadata = reader->metadata();
    const std::vector<Outcome> outcomes = read_all(*reader, limits.max_memory, scene.gaussians);
    STGS_TRY(count_outcomes(*reader, outcomes, losses));
    STGS_TRY(read_importance(*reader, losses, scene));
    scene.parts = reader->parts();
    if (losses.segments > 0) leave_out(*reader, outcomes, scene);
    const ScenePart whole = {
        0, static_cast<double>(scene.metadata.frames), scene.gaussians.size(), {}};
    if (scene.parts == std::vector<ScenePart>{whole}) scene.parts.clear();
    return scene;
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: {}", path, e.what()));
  }
}

Result<Scene> recover_scene(const std::string& path, DamageReport& losses,
                            const ReadLimits& limits) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(path));
  return recover_scene(std::move(source), losses, limits);
}

Result<Scene> read_scene(const std::string& path, const ReadLimits& limits) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(path));
  return read_scene(std::move(source), limits);
}

Result<Scene> read_scene(std::unique_ptr<ByteSource> source, const ReadLimits& limits) {
  DamageReport losses;
  STGS_ASSIGN(Scene scene, recover_scene(std::move(source), losses, limits));
  STGS_TRY(losses.reason);
  STGS_TRY(losses.importance);
  return scene;
}

}  // namespace stgs
