// SPDX-License-Identifier: Apache-2.0
// Clauses 5.2 to 5.6: the index in the payloads of INDX and FRAG.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "interchange/stgs1/file.h"

namespace stgs::stgs1 {
namespace {

constexpr std::uint64_t kMaxTotals = 1024;       // 5.2
constexpr std::uint64_t kMaxTierCount = 256;     // 5.3
constexpr std::uint64_t kPrimitivesOfByte = 16;  // 5.5
constexpr int kLevels = 32;                      // -1 to 30
constexpr std::uint64_t kMax32 = std::numeric_limits<std::uint32_t>::max();
constexpr std::uint64_t kEntry = 512, kFree = 1024;  // conformance 1.5

bool is_time(double ticks) {
  return std::abs(ticks) <= kMaxTime && std::fmod(ticks, kTimeGrain) == 0;
}
bool is_chunk_length(double ticks) {
  return ticks >= kTimeGrain && is_time(ticks);
}

bool has_too_many(std::uint64_t primitives, const Location& record) {  // 5.5
  return (primitives + kPrimitivesOfByte - 1) / kPrimitivesOfByte > record.bytes;
}

class IndexParser {
 public:
  IndexParser(View payload, std::uint64_t at, std::uint64_t end, File& file)
      : in_(payload), at_(at), end_(end), file_(file) {}

  Status read() {
    const double chunk = in_.f64();
    const std::uint64_t stated = in_.varint(), totals = in_.varint();
    if (!in_.ok() || !is_chunk_length(chunk) || (file_.chunk != 0 && chunk != file_.chunk)) {
      return invalid_file("the index has an invalid chunk length of {} ticks", chunk);
    }
    file_.chunk = chunk;
    if (totals > kMaxTotals) return invalid_file("the index has {} attribute totals", totals);
    for (std::uint64_t i = 0; i < totals; ++i) {  // only informative
      if (in_.varint() > std::numeric_limits<std::uint16_t>::max()) return truncated();
      in_.varint();
    }
    const std::uint64_t before = file_.primitives;
    const std::uint64_t parts = in_.varint();
    for (std::uint64_t p = 0; p < parts && in_.ok(); ++p) STGS_TRY(read_part());
    if (!in_.ok()) return truncated();
    file_.body_at = std::max(file_.body_at, at_);
    if (file_.primitives - before == stated) return {};
    return invalid_file("the index states {} primitives, its segments have {}", stated,
                        file_.primitives - before);
  }

 private:
  static Status truncated() {
    return invalid_file("the index is truncated, or has an invalid number");
  }

  // Checks that one more entry is within the memory limit.
  Status take_entry() {
    ++file_.entries;
    if (file_.entries <= kFree) return {};
    return file_.memory.grow(file_.entries_lease, kEntry * (file_.entries - kFree),
                             "the entries of the index");
  }

  Status advance(std::uint64_t bytes) {
    if (bytes > end_ - at_) {
      return invalid_file("the index lists {} bytes beyond the end of the body [byte {}]", bytes,
                          at_);
    }
    at_ += bytes;
    return {};
  }

  // Reads the bytes of a record's payload.
  Status take_record(Location& out) {
    const std::uint64_t payload = in_.varint();
    out.offset = at_;
    STGS_TRY(advance(kRecord));
    STGS_TRY(advance(payload));
    out.bytes = kRecord + payload;
    return {};
  }

  Status read_part() {  // 5.3
    ScenePart part;
    part.begin_ticks = in_.f64();
    part.end_ticks = in_.f64();
    const std::uint64_t number = in_.varint();
    const bool is_cut = (number & 1) != 0, has_chunk = (number & 2) != 0;
    if (is_cut) {
      part.cut.emplace();
      part.cut->begin = in_.f64();
      part.cut->end = in_.f64();
    }
    chunk_ = has_chunk ? in_.f64() : file_.chunk;
    const std::uint64_t segments = in_.varint();
    if (!in_.ok()) return truncated();
    const double begin = part.begin_ticks, end = part.end_ticks;
    if (!is_time(begin) || !is_time(end) || !(begin < end) || end - begin > kMaxTime ||
        (is_cut && (!is_time(part.cut->begin) || !is_time(part.cut->end) ||
                    part.cut->begin < std::max(begin, 0.0) || part.cut->begin >= part.cut->end ||
                    part.cut->end > end))) {
      return invalid_file("part {} has an invalid range (ticks {} to {})", file_.parts.size(),
                          begin, end);
    }
    if (!is_chunk_length(chunk_)) {
      return invalid_file("part {} has an invalid chunk length of {} ticks", file_.parts.size(),
                          chunk_);
    }
    STGS_TRY(take_entry());
    const std::uint64_t skip = number >> 2;
    STGS_TRY(advance(skip));
    if (skip > 0) file_.gaps.push_back({at_ - skip, skip});
    file_.parts.push_back(part);
    next_slot_.fill(0);
    last_begin_ = -std::numeric_limits<double>::infinity();
    last_level_ = kLevels;
    for (std::uint64_t s = 0; s < segments && in_.ok(); ++s) STGS_TRY(read_segment());
    return in_.ok() ? Status() : truncated();
  }

  // Reads the place of a segment and checks the order (5.3, 5.4, 5.6).
  Status read_place(Tier& tier) {
    const std::uint64_t place = in_.varint();
    tier.level = static_cast<int>(place % kLevels) - 1;
    std::uint64_t& next = next_slot_[place % kLevels];
    const std::uint64_t slot = place / kLevels + next;
    next = slot + 1;
    const ScenePart& part = file_.parts.back();
    const double length = part.end_ticks - part.begin_ticks;
    const bool is_persistent = tier.level < 0;
    tier.slot = static_cast<std::uint32_t>(slot);
    tier.begin = is_persistent ? 0 : std::ldexp(chunk_, tier.level - 1) * static_cast<double>(slot);
    if (!in_.ok() || slot > kMax32 || (is_persistent && slot != 0) || tier.begin >= length) {
      return invalid_file("segment {} is outside its part", file_.tiers.size());
    }
    // Of two that begin together the longer comes first, a persistent one before all.
    const double begin = is_persistent ? -1 : tier.begin;
    if (begin < last_begin_ || (begin == last_begin_ && tier.level >= last_level_)) {
      return invalid_file("segment {} is out of order in the index", file_.tiers.size());
    }
    last_begin_ = begin;
    last_level_ = tier.level;
    return {};
  }

  Status read_segment() {
    Tier tier;
    tier.part = static_cast<std::uint32_t>(file_.parts.size() - 1);
    STGS_TRY(read_place(tier));
    const std::uint64_t shape = in_.varint(), tiers = shape >> 2;
    if (!in_.ok() || tiers > kMaxTierCount || (tiers == 0 && (shape & 3) != 2)) {
      return invalid_file("segment {} has {} tiers (expected at most {}) or no records",
                          file_.tiers.size(), tiers, kMaxTierCount);
    }
    const std::size_t first = file_.tiers.size();
    for (std::uint64_t t = 0; t < tiers; ++t) {
      tier.number = static_cast<int>(t);
      const std::uint64_t n = in_.varint();
      STGS_TRY(take_record(tier.base));
      STGS_TRY(take_entry());
      if (n == 0 || n > kMax32 || has_too_many(n, tier.base)) {
        return invalid_file("segment {} states {} primitives in {} bytes", file_.tiers.size(), n,
                            tier.base.bytes);
      }
      tier.primitives = static_cast<std::uint32_t>(n);
      file_.primitives += n;
      file_.parts.back().primitives += n;
      file_.tiers.push_back(tier);
    }
    for (std::size_t i = first; (shape & 1) != 0 && i < first + tiers; ++i) {
      Tier& base = file_.tiers[i];
      STGS_TRY(take_record(base.sh));
      if (has_too_many(base.primitives, base.sh)) {
        return invalid_file("the SH of segment {} have {} bytes for {} primitives", i,
                            base.sh.bytes, base.primitives);
      }
    }
    return (shape & 2) != 0 ? read_further() : Status();
  }

  Status read_further() {
    const std::uint64_t records = in_.varint();
    if (records == 0) return invalid_file("the index has a segment of 0 further records");
    for (std::uint64_t i = 0; i < records && in_.ok(); ++i) {
      const std::uint64_t layer = in_.varint();
      if (layer < 512 || layer > std::numeric_limits<std::uint16_t>::max()) {
        return invalid_file("the index has a further record of layer {}", layer);
      }
      Location record;
      STGS_TRY(take_record(record));
      STGS_TRY(take_entry());
      file_.omit(fmt::format("further records of content {}", layer >> 8), record.bytes);
    }
    return {};
  }

  ByteReader in_;
  std::uint64_t at_, end_;  // beginning of the next record, end of the area
  File& file_;
  double chunk_ = 0;                                // of the part
  std::array<std::uint64_t, kLevels> next_slot_{};  // of the part, by level
  double last_begin_ = 0;                           // of the previous segment of the part
  int last_level_ = 0;
};

}  // namespace

Status read_index(View payload, std::uint64_t at, std::uint64_t end, File& file) {
  if (at > end) return invalid_file("the index begins beyond the end of the body [byte {}]", at);
  return IndexParser(payload, at, end, file).read();
}

}  // namespace stgs::stgs1
