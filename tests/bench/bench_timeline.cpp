// SPDX-License-Identifier: Apache-2.0
// Prints the bytes that a player reads of a long timeline, as JSON: its first read, and a seek to
// each frame.
//   bench_timeline [--primitives N] [--frames F] [--degree D] [--chunk SECONDS]
//                  [--own-layouts 0|1] [--fragments K] [-o FILE.stgs]
// A tenth of the primitives are active throughout. The lifespans of the others begin at any time
// and last 0.1 to 20 seconds, uniform in octaves. With --fragments the file is recorded in K
// fragments, each its own timeline, with memory for one fragment.
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string_view>

#include "../fixtures/scene_fixture.h"
#include "stgs/format/decoder_model.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/output_file.h"
#include "stgs/format/scene_recorder.h"

using namespace stgs;

namespace {

struct Options {
  std::size_t primitives = 2'000'000;
  std::uint32_t frames = 18'000;
  int degree = 3;
  double chunk_seconds = 0;
  bool own_layouts = false;     // as a recorder writes
  std::uint32_t fragments = 0;  // 0: written at once, not recorded
  std::string output;
};

constexpr double kFps = 30.0;
constexpr double kMinLifespan = 0.1 * kFps, kMaxLifespan = 20.0 * kFps;  // frames
// Ranges with a smaller gap are fetched as one.
constexpr std::uint64_t kGap = 16 * 1024;

Scene random_timeline(std::size_t primitives, int degree, std::uint32_t frames, unsigned seed) {
  Scene scene = testing::random_scene(primitives, degree, frames, 17 + seed);
  std::mt19937 random(23 + seed);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  Gaussians4D& set = scene.gaussians;
  const auto clip = static_cast<float>(frames);
  for (std::size_t i = 0; i < set.size(); ++i) {
    set.opacity_logit[i] = std::clamp(set.opacity_logit[i], -3.0f, 6.0f);
    if (i % 10 == 0) {
      set.time[i] = 0.5f * clip;
      set.sigma[i] = clip;
      set.radius[i] = clip;
      continue;
    }
    const auto octaves = static_cast<float>(std::log2(kMaxLifespan / kMinLifespan));
    const float half_lifespan =
        0.5f * static_cast<float>(kMinLifespan) * std::exp2(octaves * uniform(random));
    const float edge = std::sqrt(std::log(255.0f * math::opacity_of(set.opacity_logit[i])));
    set.radius[i] = half_lifespan * 0.6f * uniform(random);
    set.sigma[i] = (half_lifespan - set.radius[i]) / edge;
    set.time[i] = clip * uniform(random);
  }
  return scene;
}

// Bytes of the records of a segment.
std::uint64_t bytes_of(const SegmentInfo& segment) {
  return segment.bytes + segment.sh_bytes;
}

// The bytes of the primitives that are active at each frame; a segment's bytes are divided equally
// among its primitives.
Result<std::vector<double>> active_bytes(const SceneReader& reader) {
  const std::uint32_t frames = reader.metadata().frames;
  std::vector<double> change(frames + 1, 0.0);
  for (std::uint32_t s = 0; s < reader.segments().size(); ++s) {
    STGS_ASSIGN(const Gaussians4D set, reader.decode(s, false));
    const double per_primitive =
        static_cast<double>(bytes_of(reader.segments()[s])) / static_cast<double>(set.size());
    for (std::size_t i = 0; i < set.size(); ++i) {
      const double half =
          math::support_half_width(math::opacity_of(set.opacity_logit[i]), set.sigma[i],
                                   set.radius[i], math::kAlphaThreshold);
      const double first = std::max(0.0, std::ceil(set.time[i] - half));
      const double last = std::min<double>(frames - 1, std::floor(set.time[i] + half));
      if (half < 0.0 || first > last) continue;
      change[static_cast<std::size_t>(first)] += per_primitive;
      change[static_cast<std::size_t>(last) + 1] -= per_primitive;
    }
  }
  for (std::size_t f = 1; f < frames; ++f) change[f] += change[f - 1];
  change.pop_back();
  return change;
}

// The reads of a seek to a frame.
struct Seek {
  std::uint64_t needed = 0;  // bytes of the records
  std::uint64_t read = 0;    // with the gaps between merged ranges
  std::size_t ranges = 0, exact_ranges = 0, segments = 0;
  std::uint64_t primitives = 0;
};

Seek seek_to(const SceneReader& reader, double t) {
  Seek seek;
  std::vector<std::pair<std::uint64_t, std::uint64_t>> ranges;  // begin, end
  for (const std::uint32_t s : reader.segments_between(t, t)) {
    const SegmentInfo& segment = reader.segments()[s];
    ranges.emplace_back(segment.offset, segment.offset + segment.bytes);
    if (segment.sh_bytes > 0) {
      ranges.emplace_back(segment.sh_offset, segment.sh_offset + segment.sh_bytes);
    }
    seek.needed += bytes_of(segment);
    seek.primitives += segment.primitives;
    ++seek.segments;
  }
  std::sort(ranges.begin(), ranges.end());
  std::uint64_t end = 0, begin = 0;
  for (const auto& range : ranges) {
    seek.exact_ranges += range.first != end ? 1 : 0;
    if (end == 0 || range.first > end + kGap) {
      seek.read += end - begin;
      begin = range.first;
      ++seek.ranges;
    }
    end = range.second;
  }
  seek.read += end - begin;
  return seek;
}

// Mean and maximum of a value over the frames.
struct Spread {
  double sum = 0.0, max = 0.0;
  std::size_t count = 0;
  void add(double v) {
    sum += v;
    max = std::max(max, v);
    ++count;
  }
  nlohmann::json json() const {
    return {{"mean", sum / static_cast<double>(std::max<std::size_t>(1, count))}, {"max", max}};
  }
};

std::uint64_t peak_memory() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

Result<nlohmann::json> measure(const SceneReader& reader) {
  const std::uint64_t persistent = [&reader] {
    std::uint64_t bytes = 0;
    for (const SegmentInfo& s : reader.segments()) bytes += s.level < 0 ? bytes_of(s) : 0;
    return bytes;
  }();
  STGS_ASSIGN(const std::vector<double> active, active_bytes(reader));
  Spread ratio, without_persistent, ranges, exact, segments, read, memory;
  const auto coefficients =
      static_cast<double>((reader.sh_degree() + 1) * (reader.sh_degree() + 1));
  for (std::size_t f = 0; f < active.size(); ++f) {
    const Seek seek = seek_to(reader, static_cast<double>(f));
    ratio.add(static_cast<double>(seek.read) / active[f]);
    without_persistent.add((static_cast<double>(seek.needed) - static_cast<double>(persistent)) /
                           (active[f] - static_cast<double>(persistent)));
    ranges.add(static_cast<double>(seek.ranges));
    exact.add(static_cast<double>(seek.exact_ranges));
    segments.add(static_cast<double>(seek.segments));
    read.add(static_cast<double>(seek.read));
    memory.add(static_cast<double>(seek.primitives) * 4.0 * (17.0 + 3.0 * coefficients));
  }
  return nlohmann::json{{"read_over_active", ratio.json()},
                        {"read_over_active_without_persistent", without_persistent.json()},
                        {"bytes", read.json()},
                        {"ranges", ranges.json()},
                        {"ranges_without_gaps", exact.json()},
                        {"segments", segments.json()},
                        {"decoded_bytes", memory.json()}};
}

// Writes the timeline at once into memory and, with -o, also to the file.
Result<std::unique_ptr<ByteSource>> write(const Options& options, const WriteSettings& settings,
                                          double& encode_s) {
  const Scene scene = random_timeline(options.primitives, options.degree, options.frames, 0);
  const auto start = std::chrono::steady_clock::now();
  STGS_ASSIGN(std::vector<std::uint8_t> bytes, encode_scene(scene, settings));
  encode_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (!options.output.empty()) STGS_TRY(write_file_atomically(options.output, bytes));
  return memory_source(std::move(bytes));
}

// Records the timeline to the file.
Result<std::unique_ptr<ByteSource>> record(const Options& options, const WriteSettings& settings,
                                           double& encode_s) {
  const std::uint32_t frames = options.frames / options.fragments;
  std::filesystem::remove(options.output);
  std::unique_ptr<SceneRecorder> recorder;
  for (std::uint32_t k = 0; k < options.fragments; ++k) {
    const Scene scene =
        random_timeline(options.primitives / options.fragments, options.degree, frames, k);
    const auto start = std::chrono::steady_clock::now();
    if (recorder == nullptr) {
      STGS_ASSIGN(recorder, SceneRecorder::create(options.output, scene.metadata, options.degree,
                                                  {settings, /*sync=*/false}));
    }
    STGS_TRY(recorder->append(scene.gaussians, frames * (k + 1)));
    encode_s += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
  STGS_TRY(recorder->close());
  return open_file(options.output);
}

Status run(const Options& options) {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.chunk_seconds = options.chunk_seconds;
  settings.own_layouts = options.own_layouts;
  double encode_s = 0;
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, options.fragments > 0
                                                      ? record(options, settings, encode_s)
                                                      : write(options, settings, encode_s));
  const auto start = std::chrono::steady_clock::now();
  STGS_ASSIGN(const auto reader, SceneReader::open(std::move(source)));
  const std::chrono::duration<double> open_s = std::chrono::steady_clock::now() - start;
  STGS_ASSIGN(nlohmann::json seeks, measure(*reader));
  const DecoderNeeds needs = decoder_needs(*reader);
  const std::size_t rows = reader->segments().size();
  const nlohmann::json out = {
      {"primitives", reader->primitives()},
      {"frames", reader->metadata().frames},
      {"bytes", reader->file_bytes()},
      {"chunk_s", reader->metadata().time_base.seconds(reader->chunk_ticks())},
      {"segments", rows},
      {"first_read_bytes", reader->head_bytes()},
      {"first_read_bytes_per_segment", static_cast<double>(reader->head_bytes()) /
                                           static_cast<double>(std::max<std::size_t>(1, rows))},
      {"encode_s", encode_s},
      {"decoder_level", needs.level},
      {"startup_bytes", needs.startup_bytes},
      {"bits_per_second", needs.bits_per_second},
      {"open_s", open_s.count()},
      {"seek", std::move(seeks)},
      {"peak_memory_bytes", peak_memory()}};
  std::printf("%s\n", out.dump(2).c_str());
  return {};
}

bool parse(int argc, char** argv, Options& options) {
  for (int i = 1; i < argc; i += 2) {
    if (i + 1 == argc) return false;
    const std::string_view name = argv[i];
    if (name == "--primitives") {
      options.primitives = std::strtoull(argv[i + 1], nullptr, 10);
    } else if (name == "--frames") {
      options.frames = static_cast<std::uint32_t>(std::strtoul(argv[i + 1], nullptr, 10));
    } else if (name == "--degree") {
      options.degree = std::clamp(std::atoi(argv[i + 1]), 0, 3);
    } else if (name == "--chunk") {
      options.chunk_seconds = std::strtod(argv[i + 1], nullptr);
    } else if (name == "--own-layouts") {
      options.own_layouts = std::atoi(argv[i + 1]) != 0;
    } else if (name == "--fragments") {
      options.fragments = static_cast<std::uint32_t>(std::strtoul(argv[i + 1], nullptr, 10));
    } else if (name == "-o") {
      options.output = argv[i + 1];
    } else {
      return false;
    }
  }
  // A recording needs a file.
  return options.fragments == 0 || (!options.output.empty() && options.fragments <= options.frames);
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  if (!parse(argc, argv, options)) {
    std::fprintf(stderr,
                 "usage: bench_timeline [--primitives N] [--frames F] [--degree D] "
                 "[--chunk SECONDS] [--own-layouts 0|1] [--fragments K] [-o FILE.stgs]\n");
    return 1;
  }
  const Status status = run(options);
  if (!status.ok()) std::fprintf(stderr, "bench_timeline: %s\n", status.message().c_str());
  return static_cast<int>(status.code());
}
