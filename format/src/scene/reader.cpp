// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>

#include "scene/importance.h"
#include "scene/reader_state.h"

namespace stgs {
namespace {

// Loads the index for [t0, t1], and an eighth more than before.
void load_more(const ByteSource& source, double t0, double t1, FileHead& head, Findings& findings) {
  const std::uint64_t before = head.walk.entries;
  if (load_index(source, t0, t1, head, findings) && head.walk.entries > before)
    load_ahead(source, t1, before + before / 8, head, findings);
}

}  // namespace

ListedSegment ListedSegment::of(const SceneReader& reader, std::uint32_t segment) {
  return listed_segment(reader.state_->head, segment);
}
void ListedSegment::replace_segments(SceneReader& reader, std::span<const SegmentEnd> ends) const {
  stgs::replace_segments(*this, ends, reader.state_->head);
  reader.state_->lists = ReaderLists(reader.state_->head);
}

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

std::uint64_t SceneReader::memory_bytes() const {
  return opened_bytes(state_->head);
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
  return state_->lists.complete_ticks;
}

Result<bool> SceneReader::refresh() {
  State& state = *state_;
  bool grown = false;
  STGS_TRY(state.check_growth());
  if (!state.head.closed) STGS_TRY(state.change(state.growth(grown)));
  return grown;
}

Status SceneReader::load(double t0, double t1) {
  State& state = *state_;
  if (state.head.walk.pending.empty()) return {};
  return state.change([&](FileHead& head, Findings& findings) {
    load_more(*state.source, t0, t1, head, findings);
  });
}

bool SceneReader::is_loaded(double t0, double t1) const {
  const IndexWalk::Links& pending = state_->head.walk.pending;
  return std::none_of(pending.begin(), pending.end(), [&](const auto& one) {
    return one.link.needed.begin <= t1 && t0 <= one.link.needed.end;
  });
}

std::vector<TickRange> SceneReader::unloaded() const {
  std::vector<TickRange> out;
  for (const auto& one : state_->head.walk.pending) out.push_back(one.link.needed);
  return out;
}

Result<std::unique_ptr<SceneReader>> SceneReader::loaded(std::unique_ptr<ByteSource> source,
                                                         double t0, double t1) const {
  return state_->changed(std::move(source), [&](State& state) {
    return state.extend([&](FileHead& head, Findings& findings) {
      load_more(*state.source, t0, t1, head, findings);
    });
  });
}

Result<std::unique_ptr<SceneReader>> SceneReader::refreshed(
    std::unique_ptr<ByteSource> source) const {
  return state_->changed(std::move(source), [](State& state) -> Status {
    bool grown = false;
    STGS_TRY(state.check_growth());
    return state.extend(state.growth(grown));
  });
}

double SceneReader::latest_begin_ticks() const {
  return state_->lists.latest_begin;
}

double SceneReader::chunk_ticks() const {
  return state_->head.parts.empty() ? 1.0 : state_->head.parts.front().chunk_ticks;
}

bool SceneReader::has_layouts() const {
  return !state_->head.layouts->layouts.empty();
}

const std::vector<SegmentInfo>& SceneReader::segments() const {
  return state_->lists.segments;
}

const std::vector<ScenePart>& SceneReader::parts() const {
  return state_->lists.parts;
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
  return state_->lists.times.between(t0, t1);
}

TimeOrigin SceneReader::render_origin(std::uint32_t segment) const {
  constexpr double kMaxExactTicks = 0x1p14;  // the unit in the last place is then at most 2^-10
  const SegmentInfo* info = state_->find(segment);
  if (info == nullptr) return TimeOrigin::kPart;  // decoding reports it
  const ScenePart& part = parts()[info->part];
  return part.end_ticks - part.begin_ticks <= kMaxExactTicks ? TimeOrigin::kPart
                                                             : TimeOrigin::kRecord;
}

Result<Gaussians4D> SceneReader::decode(std::uint32_t segment, bool with_sh,
                                        TimeOrigin origin) const {
  return state_->decode(segment, with_sh, kAllAttributes, origin);
}

Status SceneReader::decode_ranges(std::uint32_t segment, bool with_sh, TimeOrigin origin,
                                  const RangeVisitor& visit) const {
  const auto pass = [&](const auto& records, const auto& head, auto ordinal, auto&,
                        auto& findings) {
    pass_ranges(records, head, ordinal, origin, visit, findings);
  };
  return state_->with_records(segment, with_sh, pass, true).status();
}

Result<Placement> SceneReader::decode_placement(std::uint32_t segment) const {
  const AttributeBits attributes = ends(segment).empty() ? kPlacement : kEndedPlacement;
  STGS_ASSIGN(Gaussians4D set, state_->decode(segment, false, attributes, TimeOrigin::kPart));
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

bool SceneReader::may_end() const {
  return (state_->head.header.flags & kHasEnds) != 0;
}

std::vector<SegmentEnd> SceneReader::ends(std::uint32_t segment) const {
  if (state_->find(segment) == nullptr) return {};
  return ends_of(state_->head, state_->head.segment(segment));
}

std::vector<std::uint64_t> SceneReader::end_records() const {
  std::vector<std::uint64_t> out;
  for (const auto& ends : state_->head.ends) out.push_back(ends->offset);
  return out;
}

std::vector<std::uint32_t> SceneReader::ended_segments(std::vector<std::uint64_t> known) const {
  return stgs::ended_segments(state_->head, std::move(known));
}

std::span<const RansLookup> SceneReader::tables() const {
  return state_->head.layouts->lookups;
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
  if (!is_damage(complete.status().code()) || state_->find(segment)->sh_bytes == 0) return complete;
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
    // Later the caller's limit counts: a long file is loaded bit by bit.
    head.limits.max_opening = std::max(limits.max_opening, limits.max_memory);
    ReaderLists lists(head);
    auto state = std::make_unique<State>(State{std::move(source), limits, loading, memory,
                                               std::move(head), findings.take(), std::move(lists)});
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
