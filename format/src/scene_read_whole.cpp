// SPDX-License-Identifier: Apache-2.0
// All segments of a file as one scene.
#include <algorithm>
#include <exception>
#include <numeric>

#include "container.h"
#include "lost_records.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

// Copies `part` into `whole` from primitive `first` on.
void place_part(const Gaussians4D& part, std::size_t first, Gaussians4D& whole) {
  const auto copy = [first](const FloatArray& from, FloatArray& to, std::size_t components) {
    std::copy(from.begin(), from.end(),
              to.begin() + static_cast<std::ptrdiff_t>(first * components));
  };
  copy(part.position, whole.position, 3);
  copy(part.log_scale, whole.log_scale, 3);
  copy(part.rotation, whole.rotation, 4);
  copy(part.opacity_logit, whole.opacity_logit, 1);
  copy(part.sh, whole.sh, 3 * static_cast<std::size_t>(part.sh_coefficients()));
  copy(part.time, whole.time, 1);
  copy(part.velocity, whole.velocity, 3);
  copy(part.sigma, whole.sigma, 1);
  copy(part.radius, whole.radius, 1);
}

// The segments from `begin` on that decoding at once takes less than the limit for, at least one:
// their bytes, their floats, and planes of no more bytes than these (spec 7.3).
std::size_t end_of_batch(const SceneReader& reader, std::size_t begin, std::uint64_t max_memory) {
  const std::vector<SegmentInfo>& segments = reader.segments();
  std::uint64_t left = max_memory;
  std::size_t end = begin;
  for (; end < segments.size(); ++end) {
    const std::uint64_t need =
        segments[end].bytes + segments[end].harmonics_bytes +
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

std::vector<Outcome> read_all(const SceneReader& reader, std::uint64_t max_memory,
                              Gaussians4D& whole) {
  const std::size_t count = reader.segments().size();
  std::vector<std::size_t> first(count);
  std::size_t total = 0;
  for (std::size_t i = 0; i < count; ++i) {
    first[i] = total;
    total += reader.segments()[i].primitives;
  }
  whole.sh_degree = reader.sh_degree();
  whole.resize(total);
  std::vector<Outcome> outcomes(count);
  for (std::size_t begin = 0, end = 0; begin < count; begin = end) {
    end = end_of_batch(reader, begin, max_memory);
    parallel_for(begin, end, [&](std::size_t i) {
      Result<Gaussians4D> part =
          reader.decode_sound(static_cast<std::uint32_t>(i), outcomes[i].harmonics);
      outcomes[i].base = part.status();
      if (part.ok()) place_part(*part, first[i], whole);
    });
  }
  return outcomes;
}

bool is_of_the_file(const Status& status) {
  return status.code() == StatusCode::kInvalidFile || status.code() == StatusCode::kUnsupported;
}

// Counts what is lost of the segments; an error that is not the file's ends the reading.
Status count_outcomes(const SceneReader& reader, const std::vector<Outcome>& outcomes,
                      SceneLosses& losses) {
  losses.of_segments = outcomes.size();
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    const SegmentInfo& segment = reader.segments()[i];
    const auto& [base, harmonics] = outcomes[i];
    const TickRange moments = {segment.begin_ticks, segment.end_ticks};
    if (!base.ok()) {
      if (!is_of_the_file(base)) return base;
      ++losses.segments;
      losses.primitives += segment.primitives;
      count_lost(losses, moments, segment.bytes + segment.harmonics_bytes, base);
    } else if (!harmonics.ok()) {
      ++losses.harmonics;
      count_lost(losses, moments, segment.harmonics_bytes, harmonics);
    }
  }
  join_moments(losses);
  if (losses.primitives > 0 && losses.primitives == reader.primitives()) return losses.reason;
  return {};
}

// The importances, where there is nothing wrong with them.
Status read_importance(const SceneReader& reader, SceneLosses& losses, Scene& scene) {
  Result<std::vector<float>> values = reader.importance();
  if (values.ok()) {
    scene.importance = std::move(values).value();
    return {};
  }
  if (!is_of_the_file(values.status())) return values.status();
  losses.importance = values.status();
  return {};
}

// Takes the primitives of lost segments out of the scene.
void leave_out(const SceneReader& reader, const std::vector<Outcome>& outcomes, Scene& scene) {
  std::vector<std::uint32_t> kept;
  std::uint32_t next = 0;
  scene.parts = reader.parts();
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    const SegmentInfo& segment = reader.segments()[i];
    if (outcomes[i].base.ok()) {
      kept.resize(kept.size() + segment.primitives);
      std::iota(kept.end() - segment.primitives, kept.end(), next);
    } else {
      scene.parts[segment.part].primitives -= segment.primitives;
    }
    next += segment.primitives;
  }
  scene.gaussians = scene.gaussians.gather(kept);
  if (scene.importance.empty()) return;
  std::vector<float> importance;
  for (const std::uint32_t i : kept) importance.push_back(scene.importance[i]);
  scene.importance = std::move(importance);
}

}  // namespace

Result<Scene> read_sound_scene(std::unique_ptr<ByteSource> source, SceneLosses& losses,
                               const ReadLimits& limits) {
  losses = {};
  const std::string path = source->name();
  STGS_ASSIGN(const std::unique_ptr<SceneReader> reader,
              SceneReader::open(std::move(source), limits));
  losses.damage = reader->damage();
  losses.lost_stretches = reader->lost_stretches();
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
    return runtime_error("{}: {}", path, e.what());
  }
}

Result<Scene> read_sound_scene(const std::string& path, SceneLosses& losses,
                               const ReadLimits& limits) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(path));
  return read_sound_scene(std::move(source), losses, limits);
}

Result<Scene> read_scene(const std::string& path, const ReadLimits& limits) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(path));
  return read_scene(std::move(source), limits);
}

Result<Scene> read_scene(std::unique_ptr<ByteSource> source, const ReadLimits& limits) {
  SceneLosses losses;
  STGS_ASSIGN(Scene scene, read_sound_scene(std::move(source), losses, limits));
  STGS_TRY(losses.reason);
  STGS_TRY(losses.importance);
  return scene;
}

}  // namespace stgs
