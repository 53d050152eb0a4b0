// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <exception>

#include "container/segment.h"
#include "container/segment_times.h"
#include "scene/importance.h"

namespace stgs {
namespace {

std::vector<SegmentInfo> segments_from(const FileHead& head) {
  std::vector<SegmentInfo> out;
  for (const SegmentEntry& segment : head.index.segments) {
    const IndexEntry &base = segment.base, &sh = segment.sh;
    const TickRange needed = needed_of(head, segment);
    out.push_back({base.level, needed.begin, needed.end, base.primitives, base.offset, base.bytes,
                   segment.part, tier_of(base.layer), sh.offset, sh.bytes, head.has(base),
                   head.has(sh),
                   is_end_needed(needed, head.parts[segment.part], head.metadata.scene.frames)});
  }
  return out;
}

std::vector<ScenePart> parts_from(const FileHead& head) {
  std::vector<ScenePart> out;
  for (const PartEntry& part : head.parts) {
    const bool complete = part.displayed == TickRange{std::max(part.begin, 0.0), part.end};
    out.push_back(
        {part.begin, part.end, 0, complete ? std::nullopt : std::optional(part.displayed)});
  }
  for (const SegmentEntry& segment : head.index.segments) {
    out[segment.part].primitives += segment.base.primitives;
  }
  return out;
}

// Returns the time up to which nothing is missing.
double complete_ticks_of(const FileHead& head, const std::vector<SegmentInfo>& segments) {
  double ticks = head.metadata.scene.frames;
  for (const LostFragment& lost : head.lost_fragments) ticks = std::min(ticks, lost.range.begin);
  for (const SegmentInfo& segment : segments) {
    const bool complete = segment.available && segment.sh_available;
    if (segment.is_needed() && !complete) ticks = std::min(ticks, segment.begin_ticks);
  }
  return ticks;
}

}  // namespace

struct SceneReader::State {
  // Extends the head with `extend`, and keeps it as it is after an error.
  template <typename Extend>
  Status change(const Extend& extend) {
    try {
      Findings findings;
      FileHead found = head;
      extend(found, findings);
      if (!findings.ok()) return findings.status(source->name());
      take(std::move(found), std::move(findings));
      return {};
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("{}: {}", source->name(), e.what()));
    }
  }

  Status load(double t0, double t1) {
    if (head.walk.pending.empty()) return {};
    return change(
        [&](FileHead& found, Findings& findings) { load_index(*source, t0, t1, found, findings); });
  }

  // Adopts a head that was extended, with further problems.
  void take(FileHead extended, Findings findings) {
    head = std::move(extended);
    for (Issue& issue : findings.take()) damage.push_back(std::move(issue));
    list_segments();
  }

  // Derives segments, parts and times from the head.
  void list_segments() {
    segments = segments_from(head);
    times = {segments, static_cast<double>(head.metadata.scene.frames)};
    parts = parts_from(head);
    complete_ticks = complete_ticks_of(head, segments);
    latest_begin = 0;
    for (const ScenePart& part : parts) latest_begin = std::max(latest_begin, part.begin_ticks);
  }

  Result<bool> refresh() {
    if (head.closed) return false;
    STGS_ASSIGN(const ByteSource::Change changed, source->refresh(head.header.file_bytes));
    if (changed == ByteSource::Change::kReplaced) {
      return invalid_file("{}: replaced or truncated below its {} complete bytes; open it again",
                          source->name(), head.header.file_bytes);
    }
    if (source->size() < head.header.file_bytes) {
      return invalid_file("{}: shrank from {} to {} complete bytes; open it again", source->name(),
                          head.header.file_bytes, source->size());
    }
    bool grown = false;
    STGS_TRY(change([&](FileHead& found, Findings& findings) {
      if (read_growth(*source, found, grown, findings) && grown &&
          loading == IndexLoading::kComplete) {
        load_index(*source, 0, found.metadata.scene.frames, found, findings);
      }
    }));
    return grown;
  }

  // Reads the records of a segment and converts them with `make`, into `out`.
  template <typename T, typename Make>
  Result<T> with_records(std::uint32_t segment, bool with_sh, const Make& make, T out) const {
    if (segment >= segments.size()) {
      return usage_error("{}: invalid segment index {} (the file has {} segments)", source->name(),
                         segment, segments.size());
    }
    try {
      Findings findings;
      SegmentRecords records;
      if (read_segment(*source, head, segment, with_sh, records, findings) && findings.ok()) {
        make(records, head, segment, out, findings);
      }
      if (!findings.ok()) return findings.status(source->name());
      return out;
    } catch (const std::exception& e) {
      return Status(code_of(e),
                    fmt::format("{}: segment {}: {}", source->name(), segment, e.what()));
    }
  }

  Result<Gaussians4D> decode(std::uint32_t segment, bool with_sh, AttributeBits attributes,
                             TimeOrigin origin) const {
    const auto make = [=](const auto& records, const auto& file, auto ordinal, auto& set,
                          auto& findings) {
      return decode_segment(records, file, ordinal, attributes, origin, set, findings);
    };
    return with_records(segment, with_sh, make, Gaussians4D(memory));
  }

  std::unique_ptr<ByteSource> source;
  ReadLimits limits;
  IndexLoading loading;
  std::pmr::memory_resource* memory;  // of decoded sets
  FileHead head;
  std::vector<Issue> damage;
  // Derived from the head by list_segments().
  std::vector<SegmentInfo> segments = {};
  SegmentTimes times = {};
  double complete_ticks = 0, latest_begin = 0;
  std::vector<ScenePart> parts = {};
};

SceneReader::SceneReader(std::unique_ptr<State> state) : state_(std::move(state)) {}
SceneReader::~SceneReader() = default;

const SceneMetadata& SceneReader::metadata() const {
  return state_->head.metadata.scene;
}

Profile SceneReader::profile() const {
  return state_->head.metadata.profile;
}

std::uint16_t SceneReader::version_major() const {
  return state_->head.header.major;
}

std::uint16_t SceneReader::version_minor() const {
  return state_->head.header.minor;
}

int SceneReader::sh_degree() const {
  return state_->head.metadata.sh_degree;
}

std::uint64_t SceneReader::primitives() const {
  return state_->head.index.primitives;
}

std::uint64_t SceneReader::file_bytes() const {
  return state_->head.header.file_bytes;
}

std::uint64_t SceneReader::head_bytes() const {
  return state_->head.index_bytes;
}

std::uint64_t SceneReader::final_bytes() const {
  const FileHead& head = state_->head;
  return head.last_fragment ? head.last_fragment->offset : head.header.file_bytes;
}

SceneForm SceneReader::form() const {
  if (!state_->head.growing()) return SceneForm::kFinished;
  return state_->head.closed ? SceneForm::kRecorded : SceneForm::kGrowing;
}

std::uint64_t SceneReader::incomplete_bytes() const {
  return state_->head.growing() ? state_->source->size() - state_->head.header.file_bytes : 0;
}

const std::vector<Issue>& SceneReader::damage() const {
  return state_->damage;
}

std::uint64_t SceneReader::missing_bytes() const {
  return state_->head.header.file_bytes -
         std::min(state_->head.available_bytes, state_->head.header.file_bytes);
}

const std::vector<LostFragment>& SceneReader::lost_fragments() const {
  return state_->head.lost_fragments;
}

double SceneReader::complete_ticks() const {
  return state_->complete_ticks;
}

Result<bool> SceneReader::refresh() {
  return state_->refresh();
}

Status SceneReader::load(double t0, double t1) {
  return state_->load(t0, t1);
}

bool SceneReader::is_loaded(double t0, double t1) const {
  const std::vector<TickRange> missing = unloaded();
  return std::none_of(missing.begin(), missing.end(),
                      [&](const TickRange& range) { return range.begin <= t1 && t0 <= range.end; });
}

std::vector<TickRange> SceneReader::unloaded() const {
  std::vector<TickRange> out;
  for (const auto& [link, depth] : state_->head.walk.pending) out.push_back(link.needed);
  return out;
}

std::unique_ptr<SceneReader> SceneReader::clone(std::unique_ptr<ByteSource> source) const {
  auto state = std::make_unique<State>(State{std::move(source), state_->limits, state_->loading,
                                             state_->memory, state_->head, state_->damage});
  state->list_segments();
  return std::unique_ptr<SceneReader>(new SceneReader(std::move(state)));
}

double SceneReader::latest_begin_ticks() const {
  return state_->latest_begin;
}

double SceneReader::chunk_ticks() const {
  return state_->head.parts.empty() ? 1.0 : state_->head.parts.front().chunk_ticks;
}

bool SceneReader::has_layouts() const {
  return !state_->head.layouts.layouts.empty();
}

const std::vector<SegmentInfo>& SceneReader::segments() const {
  return state_->segments;
}

const std::vector<ScenePart>& SceneReader::parts() const {
  return state_->parts;
}

std::vector<StreamInfo> SceneReader::streams() const {
  std::vector<StreamInfo> out;
  for (Attribute attribute : attributes_of(sh_degree())) {
    StreamInfo info{name_of(attribute),
                    0,
                    primitives() * 4 * static_cast<std::uint64_t>(components_of(attribute)),
                    {}};
    for (const AttributeBytes& row : state_->head.index.attributes) {
      if (row.attribute == static_cast<std::uint16_t>(attribute)) info.bytes += row.bytes;
    }
    for (const ErrorBound& bound : state_->head.error_bounds) {
      if (bound.attribute == attribute) info.error = bound;
    }
    out.push_back(std::move(info));
  }
  return out;
}

std::vector<std::uint32_t> SceneReader::segments_between(double t0, double t1) const {
  return state_->times.between(t0, t1);
}

TimeOrigin SceneReader::render_origin(std::uint32_t segment) const {
  constexpr double kMaxExactTicks = 0x1p14;  // the unit in the last place is then at most 2^-10
  if (segment >= segments().size()) return TimeOrigin::kPart;  // decoding reports it
  const ScenePart& part = parts()[segments()[segment].part];
  return part.end_ticks - part.begin_ticks <= kMaxExactTicks ? TimeOrigin::kPart
                                                             : TimeOrigin::kRecord;
}

Result<Gaussians4D> SceneReader::decode(std::uint32_t segment, bool with_sh,
                                        TimeOrigin origin) const {
  return state_->decode(segment, with_sh, kAllAttributes, origin);
}

Result<Placement> SceneReader::decode_placement(std::uint32_t segment) const {
  STGS_ASSIGN(Gaussians4D set, state_->decode(segment, false, kPlacement, TimeOrigin::kPart));
  return Placement{std::move(set.position), std::move(set.time)};
}

Result<CodedSegment> SceneReader::read(std::uint32_t segment, bool with_sh,
                                       TimeOrigin origin) const {
  const auto code = [origin](const auto& records, const auto& head, auto ordinal, auto& coded,
                             auto& findings) {
    return code_segment(records, head, ordinal, origin, coded, findings);
  };
  return state_->with_records(segment, with_sh, code, CodedSegment());
}

std::span<const RansLookup> SceneReader::tables() const {
  return state_->head.layouts.lookups;
}

Result<std::vector<float>> SceneReader::importance() const {
  return read_importance(*state_->source, state_->head);
}

const std::optional<Quantisation>& SceneReader::quantisation() const {
  return state_->head.quantisation;
}

const std::vector<ErrorBound>& SceneReader::error_bounds() const {
  return state_->head.error_bounds;
}

const char* profile_name(Profile profile) {
  switch (profile) {
    case Profile::kLossless:
      return "lossless";
    case Profile::kQuantised:
      return "quantised";
    case Profile::kDraco:
      return "draco";
    case Profile::kNearLossless:
      return "near-lossless";
    case Profile::kUnknown:
      break;
  }
  return "unknown";
}

Result<Gaussians4D> SceneReader::decode_intact(std::uint32_t segment, Status& sh_status,
                                               TimeOrigin origin) const {
  sh_status = {};
  Result<Gaussians4D> complete = decode(segment, true, origin);
  const StatusCode code = complete.status().code();
  const bool is_damage = code == StatusCode::kInvalidFile || code == StatusCode::kUnsupported;
  if (!is_damage || segments()[segment].sh_bytes == 0) return complete;
  Result<Gaussians4D> base = decode(segment, false, origin);
  if (!base.ok()) return base;
  sh_status = complete.status();
  return base;
}

Result<std::unique_ptr<SceneReader>> SceneReader::open(std::unique_ptr<ByteSource> source,
                                                       const ReadLimits& limits,
                                                       std::pmr::memory_resource* memory,
                                                       IndexLoading loading) {
  try {
    Findings findings;
    FileHead head;
    read_head(*source, limits, loading, head, findings);
    if (!findings.ok()) return findings.status(source->name());
    auto state = std::make_unique<State>(
        State{std::move(source), limits, loading, memory, std::move(head), findings.take()});
    state->list_segments();
    return std::unique_ptr<SceneReader>(new SceneReader(std::move(state)));
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("cannot open the file: {}", e.what()));
  }
}

Result<std::unique_ptr<SceneReader>> SceneReader::open(const std::string& path,
                                                       const ReadLimits& limits) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(path));
  return open(std::move(source), limits);
}

}  // namespace stgs
