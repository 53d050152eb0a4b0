// SPDX-License-Identifier: Apache-2.0
#include "mov_tables.h"

#include <algorithm>
#include <array>

namespace stgs::encoder {
namespace {

using std::string_view_literals::operator""sv;

// Fewest bytes of a sample with its table entry. Samples of uncompressed sound may be smaller.
constexpr std::uint64_t kSampleBytes = 4;
constexpr std::uint64_t kAnyFile = 65536 * kSampleBytes, kFewEdits = 4;
constexpr std::uint64_t kSamplesPerEntry = 160;  // fewest, of a chunk of sound
constexpr std::uint64_t kMaxMovTracks = 1000;

// Tables whose count follows 4 bytes, and whose entries follow it, with the bytes of an entry.
struct Plain {
  std::string_view kind;
  std::uint64_t entry_bytes;
};
constexpr std::array kPlain = {Plain{"stts", 8}, Plain{"stss", 4}, Plain{"stps", 4},
                               Plain{"stco", 4}, Plain{"co64", 8}, Plain{"stsc", 12}};
constexpr std::array kOther = {"stsz"sv, "stz2"sv, "ctts"sv, "sbgp"sv,
                               "trun"sv, "elst"sv, "sidx"sv, "cmov"sv};

void add_to(std::uint64_t& sum, std::uint64_t value) {
  sum += std::min(value, ~sum);  // at most the greatest number
}

}  // namespace

bool has_mov_table(std::string_view text) {
  const auto is_found = [&](std::string_view kind) { return text.find(kind) != text.npos; };
  return std::any_of(kOther.begin(), kOther.end(), is_found) ||
         std::any_of(kPlain.begin(), kPlain.end(),
                     [&](const Plain& p) { return is_found(p.kind); });
}

std::uint64_t MovTables::number(std::uint64_t at, std::size_t bytes) {
  const Result<std::uint64_t> value = file_.number(at, bytes);
  if (value.ok()) return *value;
  if (failure_.ok()) failure_ = value.status();
  return 0;
}

bool MovTables::holds(const MovBox& box, std::uint64_t at, std::uint64_t entries,
                      std::uint64_t entry_bytes) {
  return entries == 0 || (at <= box.end && entries <= (box.end - at) / entry_bytes);
}

void MovTables::begin(const MovBox& box) {
  if (box.kind == "moof") ++fragments_;
  if (box.kind != "trak") return;
  ++tracks_;
  chunks_ = 0;
  runs_.clear();
}

bool MovTables::end(const MovBox& box) {
  if (box.kind != "trak") return true;
  return tracks_ <= kMaxMovTracks &&
         std::all_of(runs_.begin(), runs_.end(), [&](const MovBox& r) { return add_chunks(r); });
}

// Adds the entries of chunks: run k has the chunks before the first one of run k + 1.
bool MovTables::add_chunks(const MovBox& runs) {
  const std::uint64_t count = number(runs.begin + 4);
  for (std::uint64_t k = 0; k < count; ++k) {
    const std::uint64_t at = runs.begin + 8 + 12 * k, first = number(at), samples = number(at + 4);
    const std::uint64_t next = k + 1 < count ? number(at + 12) : std::max(chunks_ + 1, first);
    if (k + 1 < count && next <= first) return false;
    const std::uint64_t chunks = std::min(next - first, chunks_);
    add_to(chunked_, kSampleBytes * chunks * (samples / kSamplesPerEntry + 1));
  }
  return true;
}

bool MovTables::add_sizes(const MovBox& box) {
  const std::uint64_t size = number(box.begin + 4), count = number(box.begin + 8);
  constexpr std::uint64_t kHeader = 12;
  if (box.kind == "stz2") {
    add_to(samples_, kSampleBytes * count);
    return holds(box, box.begin + kHeader, (count * (size & 0xFF) + 7) / 8, 1);
  }
  add_to(samples_, (size == 0 ? kSampleBytes : std::min(size, kSampleBytes)) * count);
  return size > 0 || holds(box, box.begin + kHeader, count, 4);
}

// Adds the counts of samples with which the entries of 8 bytes from `at` on begin; their number is
// in the 4 bytes before.
bool MovTables::add_counts(const MovBox& box, std::uint64_t at, std::uint64_t& sum) {
  const std::uint64_t count = number(at - 4);
  if (!holds(box, at, count, 8)) return false;
  for (std::uint64_t k = 0; k < count; ++k) add_to(sum, kSampleBytes * number(at + 8 * k));
  return true;
}

bool MovTables::add(const MovBox& box) {
  const std::uint64_t version = number(box.begin, 1), count = number(box.begin + 4);
  if (box.kind == "stsz" || box.kind == "stz2") return add_sizes(box);
  if (box.kind == "ctts") return add_counts(box, box.begin + 8, offsets_);
  if (box.kind == "sbgp") return add_counts(box, box.begin + (version == 1 ? 16 : 12), groups_);
  if (box.kind == "trun") add_to(samples_, kSampleBytes * count);
  if (box.kind == "elst") {
    edits_ = std::max(edits_, count);
    return holds(box, box.begin + 8, count, version == 1 ? 20 : 12);
  }
  if (box.kind == "sidx") fragments_ += number(box.begin + (version == 0 ? 22 : 30), 2);
  if (box.kind == "stco" || box.kind == "co64") chunks_ = std::max(chunks_, count);
  if (box.kind == "stsc") runs_.push_back(box);
  const auto plain = std::find_if(kPlain.begin(), kPlain.end(),
                                  [&](const Plain& p) { return p.kind == box.kind; });
  return plain == kPlain.end() || holds(box, box.begin + 8, count, plain->entry_bytes);
}

bool MovTables::fit(std::uint64_t bytes) const {
  const std::uint64_t copies = edits_ <= kFewEdits ? 1 : edits_;
  const std::uint64_t most = (kAnyFile + bytes) / copies;
  return std::max({samples_, chunked_, offsets_, groups_}) <= most &&
         fragments_ <= (kAnyFile + bytes) / kSampleBytes / std::max<std::uint64_t>(1, tracks_);
}

}  // namespace stgs::encoder
