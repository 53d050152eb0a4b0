// SPDX-License-Identifier: Apache-2.0
// Import of the temporal model gaussian-birth.
#include <algorithm>
#include <numbers>
#include <numeric>

#include "interchange/fourdgs_scene.h"
#include "interchange/import.h"
#include "stgs/format/math/blend.h"

namespace stgs::fourdgs {
namespace {

constexpr std::uint32_t kUncut = 0xFFFFFFFF;  // no part of its own
// A window cuts a fade off if the visibility at its edge is greater than this many times the
// cut-off of the file. Writers let windows end where fades are cut off, within rounding.
constexpr double kCutFactor = 1.5;
// Sigma of the ends of a flat top, ticks, and the time after which an opaque primitive is
// invisible.
constexpr double kEdge = 1.0 / 1024, kEdgeWidth = 2.3541 * kEdge;
constexpr double kMinSigma = 1e-6, kMaxSigma = 1e30;  // ticks
constexpr double kTimeGrid = 1 << 20;                 // steps per tick of the times of a part

// Times in ticks.
class Importer {
 public:
  Importer(const Contents& contents, const TimeBase& base, std::uint32_t frames,
           ColourConverter colours, bool flat, FourdgsReport& report)
      : contents_(contents),
        base_(base),
        clip_(frames),
        colours_(std::move(colours)),
        flat_(flat),
        report_(report) {
    scene_.metadata.time_base = base;
    scene_.metadata.frames = frames;
    scene_.gaussians.sh_degree = contents.header.sh_degree;
  }

  // Allocates the primitives. Call it first.
  Status reserve(ImportMemory& memory) {
    const std::uint64_t count = contents_.header.gaussians;
    STGS_ASSIGN(lease_, memory.take_set(count, contents_.header.sh_degree));
    STGS_ASSIGN(Lease parts, memory.take(sizeof(part_of_[0]) * count, "the windows of primitives"));
    lease_.merge(std::move(parts));
    scene_.gaussians.reserve(static_cast<std::size_t>(count));
    part_of_.reserve(static_cast<std::size_t>(count));
    return {};
  }

  Status add(const Population& set, const Place& place) {
    const std::size_t sh = set.size() > 0 ? set.sh.size() / set.size() : 0;
    for (std::size_t i = 0; i < set.size(); ++i) {
      const std::int32_t index = set.bins[kWindow][i];
      if (index < 0 || static_cast<std::size_t>(index) >= contents_.windows.size()) {
        return invalid_file("{}: window {} is not in the table of {} windows{}", place.file, index,
                            contents_.windows.size(), place.text());
      }
      const auto window = static_cast<std::uint32_t>(index);
      add(dequantise(set, i, contents_.grid, contents_.windows[window]), window,
          set.sh.data() + sh * i);
    }
    return {};
  }

  Result<Scene> finish(ImportMemory& memory, ConversionNotes* notes) {
    STGS_TRY(split_into_parts(memory));
    const auto total = contents_.header.gaussians;
    if (invalid_ > 0) {
      note(notes, fmt::format("dropped {} of {} primitives with values that are not finite",
                              invalid_, total));
    }
    if (never_visible_ > 0) {
      note(notes, fmt::format("dropped {} of {} primitives that are never visible", never_visible_,
                              total));
    }
    if (report_.continued_fades > 0) {
      note(notes,
           fmt::format("{} of {} primitives fade out where the file cuts their fade off: their "
                       "opacity differs by up to {:.3g}",
                       report_.continued_fades, total, report_.cut_max));
    }
    colours_.add_notes(notes);
    finish_scene(contents_, scene_, notes);
    return std::move(scene_);
  }

 private:
  void add(Gaussian g, std::uint32_t window, const std::uint8_t* sh) {
    // Beyond the clip a window makes no difference.
    const Window& times = contents_.windows[window];
    if (is_never_visible(g, times, contents_.header.duration, contents_.grid.cutoff)) {
      ++never_visible_;
      return;
    }
    const double begin = std::max(0.0, base_.ticks(times.begin));
    const double end = std::min(clip_, base_.ticks(times.end));
    g.centre = base_.ticks(g.centre);
    g.deviation = base_.ticks(g.deviation);
    for (double& v : g.motion) v = base_.seconds(v);  // per second -> per tick
    if (!is_representable(g)) {
      ++invalid_;
      return;
    }
    if (std::isinf(g.deviation)) {
      add_flat_top(g, begin, end);
    } else {
      add_fade(g, begin, end, window);
    }
    Gaussians4D& set = scene_.gaussians;
    append_shape(g, set);
    colours_.append(g.rgb, sh, set.sh);
  }

  void add_lifespan(const Gaussian& g, double time, double sigma, double radius) {
    Gaussians4D& set = scene_.gaussians;
    for (std::size_t c = 0; c < 3; ++c) {
      set.position.push_back(static_cast<float>(g.position[c] + g.motion[c] * (time - g.centre)));
      set.velocity.push_back(static_cast<float>(g.motion[c]));
    }
    set.time.push_back(static_cast<float>(time));
    set.sigma.push_back(static_cast<float>(sigma));
    set.radius.push_back(static_cast<float>(radius));
  }

  void add_flat_top(const Gaussian& g, double begin, double end) {
    part_of_.push_back(kUncut);
    if (begin == 0 && end == clip_) {
      add_lifespan(g, clip_ / 2, 1, clip_);  // as set_static_lifespan()
      return;
    }
    // The window includes its beginning, but not its end, also after rounding to binary32.
    const double shift = std::max(kEdge, clip_ * 0x1p-22);
    const double first = begin == 0 ? -clip_ / 2 : begin - shift;
    const double last = end == clip_ ? 3 * clip_ / 2 : end - shift - kEdgeWidth;
    add_lifespan(g, (first + last) / 2, kEdge, std::max(0.0, (last - first) / 2));
  }

  void add_fade(const Gaussian& g, double begin, double end, std::uint32_t window) {
    const double cutoff = contents_.grid.cutoff;
    const double at_begin = begin > 0 ? visibility(g, begin, cutoff) : 0;
    const double at_end = end < clip_ ? visibility(g, end, cutoff) : 0;
    const double edge = std::max(at_begin, at_end);
    const bool cut =
        !flat_ && edge > kCutFactor * cutoff && edge * g.opacity >= math::kAlphaThreshold;
    part_of_.push_back(cut ? window : kUncut);
    const double continued = std::max(cutoff, cut ? 0 : edge) * g.opacity;
    if (continued >= math::kAlphaThreshold) {
      ++report_.continued_fades;
      report_.cut_max = std::max(report_.cut_max, continued);
    }
    add_lifespan(g, g.centre, std::clamp(std::numbers::sqrt2 * g.deviation, kMinSigma, kMaxSigma),
                 0);
  }

  // Puts the primitives whose fades are cut off into a part for each window.
  Status split_into_parts(ImportMemory& memory) {
    Gaussians4D& set = scene_.gaussians;
    if (std::all_of(part_of_.begin(), part_of_.end(), [](auto p) { return p == kUncut; })) {
      return {};
    }
    // A copy in order, the order and the memory to sort it, and the list of parts as it grows.
    const std::uint64_t parts = std::min<std::uint64_t>(set.size(), contents_.windows.size() + 1);
    STGS_ASSIGN(const Lease copy, memory.take_set(set.size(), set.sh_degree));
    STGS_ASSIGN(const Lease lists,
                memory.take(2 * sizeof(std::uint32_t) * set.size(), "the order of primitives"));
    STGS_ASSIGN(Lease list, memory.take(3 * sizeof(ScenePart) * parts, "the parts of the scene"));
    lease_.merge(std::move(list));
    std::vector<std::uint32_t> order(set.size());
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(), [this](std::uint32_t a, std::uint32_t b) {
      return part_of_[a] + 1 < part_of_[b] + 1;  // those without a part of their own first
    });
    set = set.gather(order);
    for (std::size_t i = 0; i < set.size(); ++i) {
      const std::uint32_t window = part_of_[order[i]];
      if (i == 0 || window != part_of_[order[i - 1]]) scene_.parts.push_back(part_for(window));
      ScenePart& part = scene_.parts.back();
      ++part.primitives;
      set.time[i] = static_cast<float>(set.time[i] - part.begin_ticks);
    }
    return {};
  }

  ScenePart part_for(std::uint32_t window) const {
    if (window == kUncut) return {0, clip_, 0};
    const Window& times = contents_.windows[window];
    const auto on_grid = [](double ticks) { return std::round(ticks * kTimeGrid) / kTimeGrid; };
    const double begin = on_grid(std::clamp(base_.ticks(times.begin), 0.0, clip_));
    const double end = on_grid(std::clamp(base_.ticks(times.end), 0.0, clip_));
    return {begin, std::max(end, begin + 1 / kTimeGrid), 0};
  }

  const Contents& contents_;
  TimeBase base_;
  double clip_;
  ColourConverter colours_;
  bool flat_;
  FourdgsReport& report_;
  Scene scene_;
  Lease lease_;                         // of the scene, and of the list below
  std::vector<std::uint32_t> part_of_;  // index of the window that cuts a primitive off
  std::uint64_t invalid_ = 0, never_visible_ = 0;
};

struct ChunkFields {
  std::string codec;
  std::uint64_t bytes = 0;
  View records;
};

Result<ChunkFields> parse_chunk(View content, const Place& place) {
  ByteReader in(content);
  in.bytes(24);  // interval, level and count, read before
  ChunkFields chunk;
  chunk.codec = in.string();
  chunk.bytes = in.u64();
  chunk.records = in.bytes(in.u64());
  if (in.ok()) return chunk;
  return invalid_file("{}: a chunk is shorter than its contents{}", place.file, place.text());
}

}  // namespace

Status check_objects(const Contents& contents, const Population& set, const Place& place) {
  if (contents.moving_objects.empty()) return {};
  for (const std::uint32_t object : set.objects) {
    if (contents.moving_objects.count(object) == 0) continue;
    return unsupported("{}: object {} moves along a track, which is not supported{}", place.file,
                       object, place.text());
  }
  return {};
}

Status read_chunk(const ByteSource& source, const Contents& contents, const BodyRecord& record,
                  ImportMemory& memory, Population& out) {
  const Place place = place_of(contents, record);
  STGS_ASSIGN(const ChargedBytes content, read_body(source, record, memory));
  STGS_ASSIGN(const ChunkFields chunk, parse_chunk(content.value, place));
  STGS_ASSIGN(const ChargedBytes block,
              unpack_chunk(chunk.records, chunk.codec, chunk.bytes, memory, place));
  return read_population(block.value, record.count, true, contents.has_keyframes(), memory, place,
                         out);
}

Result<Scene> read_birth(const ByteSource& source, const Contents& contents, const TimeBase& base,
                         ImportMemory& memory, bool flat, FourdgsReport& report,
                         ConversionNotes* notes) {
  constexpr std::uint32_t kMaxFrames = 1'000'000;
  STGS_ASSIGN(const std::uint32_t frames, count_frames(contents, base, kMaxFrames));
  STGS_TRY(memory.check_count(contents.header.gaussians));
  // A first pass makes sure that there is data for all of them.
  for (const BodyRecord& record : contents.body) {
    if (record.count / kMaxPerByte <= record.length) continue;
    return invalid_file("{}: {} Gaussians do not fit in a chunk of {} bytes [byte {}]",
                        contents.file, record.count, record.length, record.offset);
  }
  STGS_ASSIGN(ColourConverter colours, ColourConverter::create(contents));
  Importer importer(contents, base, frames, std::move(colours), flat, report);
  STGS_TRY(importer.reserve(memory));
  for (std::size_t next = 0; next < contents.body.size();) {
    const BodyRecord& record = contents.body[next++];
    Population set;
    STGS_TRY(read_chunk(source, contents, record, memory, set));
    STGS_TRY(check_objects(contents, set, place_of(contents, record)));
    STGS_ASSIGN(const Lease lease,
                memory.take(sizeof(std::uint32_t) * set.size(), "the rows of a chunk"));
    std::vector<std::uint32_t> rows(set.size());
    std::iota(rows.begin(), rows.end(), 0u);
    STGS_TRY(read_sh(source, contents, next, rows, memory, set));
    STGS_TRY(importer.add(set, place_of(contents, record)));
  }
  return importer.finish(memory, notes);
}

}  // namespace stgs::fourdgs
