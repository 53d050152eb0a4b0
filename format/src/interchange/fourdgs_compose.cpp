// SPDX-License-Identifier: Apache-2.0
#include "interchange/fourdgs_compose.h"

#include <algorithm>
#include <numeric>

#include "interchange/fourdgs_scene.h"
#include "interchange/import.h"

namespace stgs::fourdgs {
namespace {

using Rows = std::vector<std::uint32_t>;

// Returns the order of ascending identities. kInvalidFile if one occurs twice.
Result<Rows> sorted_rows(const std::vector<std::uint32_t>& ids, const Place& place) {
  Rows rows(ids.size());
  std::iota(rows.begin(), rows.end(), 0u);
  std::sort(rows.begin(), rows.end(), [&](auto a, auto b) { return ids[a] < ids[b]; });
  for (std::size_t i = 1; i < rows.size(); ++i) {
    if (ids[rows[i]] != ids[rows[i - 1]]) continue;
    return invalid_file("{}: Gaussian {} occurs twice in a chunk{}", place.file, ids[rows[i]],
                        place.text());
  }
  return rows;
}

template <typename T>
void gather(std::vector<T>& values, const Rows& rows, std::size_t channels) {
  std::vector<T> out;
  out.reserve(rows.size() * channels);
  for (const std::uint32_t row : rows) {
    const auto first = values.begin() + static_cast<std::ptrdiff_t>(row * channels);
    out.insert(out.end(), first, first + static_cast<std::ptrdiff_t>(channels));
  }
  values = std::move(out);
}

void gather(Population& set, const Rows& rows) {
  const std::size_t sh = set.ids.empty() ? 0 : set.sh.size() / set.ids.size();
  gather(set.ids, rows, 1);
  for (std::size_t a = 0; a < kAttributes; ++a) gather(set.bins[a], rows, kChannels[a]);
  gather(set.sh, rows, sh);
}

// Appends without allocating more than needed.
template <typename T>
void append(std::vector<T>& values, const std::vector<T>& other) {
  values.reserve(values.size() + other.size());
  values.insert(values.end(), other.begin(), other.end());
}

void append(Population& set, const Population& other, std::size_t sh_bytes) {
  append(set.ids, other.ids);
  for (std::size_t a = 0; a < kAttributes; ++a) append(set.bins[a], other.bins[a]);
  set.sh.reserve(set.ids.size() * sh_bytes);
  set.sh.resize(set.ids.size() * sh_bytes);
}

// The three groups of a delta chunk.
struct Delta {
  Population updates, births, deaths;
};

Result<Delta> parse_delta(View content, const Contents& contents, const BodyRecord& record,
                          ImportMemory& memory) {
  const Place place = place_of(contents, record);
  ByteReader in(content);
  in.bytes(51);  // fields read before
  const std::string codec = in.string();
  const std::uint64_t bytes = in.u64();
  const View packed = in.bytes(in.u64());
  if (!in.ok()) {
    return invalid_file("{}: a delta chunk is shorter than its contents{}", place.file,
                        place.text());
  }
  STGS_ASSIGN(const ChargedBytes block, unpack_chunk(packed, codec, bytes, memory, place));
  ByteReader groups(block.value);
  const View updates = groups.bytes(groups.u64()), births = groups.bytes(groups.u64()),
             deaths = groups.bytes(groups.u64());
  if (!groups.ok() || groups.left() > 0) {
    return invalid_file("{}: the groups of a delta chunk do not fill it{}", place.file,
                        place.text());
  }
  Delta out;
  STGS_TRY(read_population(updates, record.count, false, true, memory, place, out.updates));
  STGS_TRY(read_population(births, record.births, true, true, memory, place, out.births));
  STGS_TRY(read_population(deaths, record.deaths, false, true, memory, place, out.deaths));
  const auto& bins = out.updates.bins;
  if (!bins[kSigma].empty() || !bins[kFlags].empty() || !bins[kWindow].empty()) {
    return invalid_file("{}: an update changes the sigma, flags or window of a Gaussian{}",
                        place.file, place.text());
  }
  if (bins[kRotation].empty() != bins[kRotationIndex].empty()) {
    return invalid_file("{}: an update has half of a rotation{}", place.file, place.text());
  }
  return out;
}

}  // namespace

Composer::Composer(const ByteSource& source, const Contents& contents, ImportMemory& memory)
    : source_(source), contents_(contents), memory_(memory) {
  const auto degree = static_cast<std::size_t>(contents.header.sh_degree);
  sh_bytes_ = 3 * ((degree + 1) * (degree + 1) - 1);
}

// Reads the chunk `next` of the body with its SH, and advances `next` past them.
Status Composer::read(std::size_t& next) {
  const BodyRecord& record = contents_.body[next++];
  STGS_ASSIGN(const Lease lease,
              take_scratch(state_.ids.size() + record.count + record.births + record.deaths));
  Rows stated;  // rows of the state in the order in which the chunk states them
  STGS_TRY(record.opcode == kChunk ? read_keyframe(record, stated) : read_delta(record, stated));
  STGS_TRY(read_sh(source_, contents_, next, stated, memory_, state_));
  if (record.opcode == kChunk && needs_keyframe(next)) STGS_TRY(copy(state_, keyframe_));
  last_ = record;
  return {};
}

// Charges the memory for changing a state of `count` Gaussians: a copy of its largest array, and
// lists of identities and rows as they grow.
Result<Lease> Composer::take_scratch(std::size_t count) {
  constexpr std::size_t kLists = 10 * sizeof(std::uint32_t), kLargest = 3 * sizeof(std::int32_t);
  return memory_.take(std::uint64_t{count} * (kLists + std::max(kLargest, sh_bytes_)),
                      fmt::format("the changes of {} Gaussians", count));
}

Status Composer::copy(const Population& from, Population& to) {
  to = {};
  STGS_ASSIGN(to.lease, memory_.take(from.bytes(), "the states of Gaussians"));
  to.ids = from.ids;
  to.bins = from.bins;
  to.sh = from.sh;
  to.objects = from.objects;
  return {};
}

// Returns whether a delta chunk of this group refers to the keyframe.
bool Composer::needs_keyframe(std::size_t next) const {
  for (; next < contents_.body.size() && contents_.body[next].opcode != kChunk; ++next) {
    if (contents_.body[next].opcode == kDeltaChunk && !contents_.body[next].chained) return true;
  }
  return false;
}

Status Composer::read_keyframe(const BodyRecord& record, Rows& stated) {
  STGS_TRY(memory_.check_count(record.count));
  state_ = {};
  keyframe_ = {};
  const Place place = place_of(contents_, record);
  STGS_TRY(read_chunk(source_, contents_, record, memory_, state_));
  STGS_TRY(check_objects(contents_, state_, place));
  STGS_ASSIGN(const Rows rows, sorted_rows(state_.ids, place));
  gather(state_, rows);
  stated.resize(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) stated[rows[i]] = static_cast<std::uint32_t>(i);
  keyframe_at_ = record.offset;
  return {};
}

Status Composer::check_reference(const BodyRecord& record) const {
  const auto bad = [&](const char* field, std::uint64_t expected, std::uint64_t got) {
    return invalid_file("{}: a delta chunk has an invalid {} (expected {}, got {}) [byte {}]",
                        contents_.file, field, expected, got, record.offset);
  };
  if (!last_) {
    return invalid_file("{}: a delta chunk before the first keyframe [byte {}]", contents_.file,
                        record.offset);
  }
  const std::uint64_t reference = record.chained ? last_->offset : keyframe_at_;
  if (record.reference != reference) return bad("reference", reference, record.reference);
  if (record.keyframe != keyframe_at_) return bad("keyframe", keyframe_at_, record.keyframe);
  const std::uint32_t depth = record.chained ? last_->depth + 1 : 1;
  if (record.depth != depth) return bad("depth", depth, record.depth);
  return record.level == last_->level ? Status() : bad("level", last_->level, record.level);
}

Status Composer::read_delta(const BodyRecord& record, Rows& stated) {
  STGS_TRY(check_reference(record));
  const std::uint64_t most = std::uint64_t{record.count} + record.births + record.deaths;
  STGS_TRY(memory_.check_count(most));
  STGS_ASSIGN(const ChargedBytes content, read_body(source_, record, memory_));
  STGS_ASSIGN(const Delta delta, parse_delta(content.value, contents_, record, memory_));
  if (!record.chained) STGS_TRY(copy(keyframe_, state_));
  const Place place = place_of(contents_, record);
  std::vector<std::uint32_t> ids = delta.updates.ids;
  for (const auto* more : {&delta.births.ids, &delta.deaths.ids}) {
    ids.insert(ids.end(), more->begin(), more->end());
  }
  STGS_TRY(sorted_rows(ids, place).status());  // one group for each Gaussian
  STGS_TRY(check_objects(contents_, delta.births, place));
  STGS_TRY(update(delta.updates, place));
  STGS_TRY(remove(delta.deaths.ids, place));
  return add(delta.births, place, stated);
}

Result<std::uint32_t> Composer::row_of(std::uint32_t id, const Place& place) const {
  const auto found = std::lower_bound(state_.ids.begin(), state_.ids.end(), id);
  if (found != state_.ids.end() && *found == id) {
    return static_cast<std::uint32_t>(found - state_.ids.begin());
  }
  return invalid_file("{}: Gaussian {} is changed, but does not exist{}", place.file, id,
                      place.text());
}

Status Composer::update(const Population& changes, const Place& place) {
  for (std::size_t i = 0; i < changes.ids.size(); ++i) {
    STGS_ASSIGN(const std::uint32_t row, row_of(changes.ids[i], place));
    for (std::size_t a = 0; a < kAttributes; ++a) {
      if (changes.bins[a].empty()) continue;
      const bool absolute = a == kRotation || a == kRotationIndex;
      for (std::size_t c = 0; c < kChannels[a]; ++c) {
        std::int32_t& bin = state_.bins[a][row * kChannels[a] + c];
        const std::int64_t sum =
            (absolute ? 0 : std::int64_t{bin}) + changes.bins[a][i * kChannels[a] + c];
        if (sum != static_cast<std::int32_t>(sum)) {
          return invalid_file("{}: stream {} of Gaussian {} exceeds 32 bits{}", place.file, a,
                              changes.ids[i], place.text());
        }
        bin = static_cast<std::int32_t>(sum);
      }
    }
  }
  return {};
}

Status Composer::remove(const std::vector<std::uint32_t>& ids, const Place& place) {
  if (ids.empty()) return {};
  std::vector<std::uint8_t> dead(state_.ids.size());
  for (const std::uint32_t id : ids) {
    STGS_ASSIGN(const std::uint32_t row, row_of(id, place));
    dead[row] = 1;
  }
  Rows rows;
  for (std::uint32_t i = 0; i < dead.size(); ++i) {
    if (dead[i] == 0) rows.push_back(i);
  }
  gather(state_, rows);
  state_.lease.resize(state_.bytes());
  return {};
}

Status Composer::add(const Population& births, const Place& place, Rows& stated) {
  if (births.ids.empty()) return {};
  const std::size_t old = state_.ids.size();
  STGS_TRY(memory_.check_count(old + births.ids.size()));
  STGS_ASSIGN(Lease lease, memory_.take(births.bytes() + sh_bytes_ * births.ids.size(),
                                        "the states of Gaussians"));
  state_.lease.merge(std::move(lease));
  append(state_, births, sh_bytes_);
  STGS_ASSIGN(const Rows rows, sorted_rows(state_.ids, place));
  gather(state_, rows);
  stated.resize(births.ids.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i] >= old) stated[rows[i] - old] = static_cast<std::uint32_t>(i);
  }
  return {};
}

}  // namespace stgs::fourdgs
