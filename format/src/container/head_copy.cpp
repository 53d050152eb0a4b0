// SPDX-License-Identifier: Apache-2.0
// Reading the copy of a head, in case the head is damaged (spec 3.6).
#include <algorithm>

#include "codec/zstd_frame.h"
#include "container/container.h"
#include "core/bytes.h"

namespace stgs {
namespace {

using N = IssueNumber;
using Bytes = std::vector<std::uint8_t>;
using FoundCopy = std::optional<HeadCopy>;

// Records skipped in search of a copy if the length of the head is unknown.
constexpr int kMaxRecordsBefore = 64;

// Returns the head that the payload of a COPY record contains; empty if it is invalid.
Bytes unpack_copy(std::span<const std::uint8_t> payload, const FileHeader& header) {
  const auto records =
      payload.subspan(kHeaderBytes, payload.size() - kHeaderBytes - kHeadLengthBytes);
  const std::uint64_t size = header.head_bytes - kHeaderBytes;
  if (records.size() != size && zstd_frame_problem(records, size) != nullptr) return {};
  Bytes out(header.head_bytes);
  std::copy_n(payload.begin(), kHeaderBytes, out.begin());
  const auto rest = std::span(out).subspan(kHeaderBytes);
  if (records.size() == size) {
    std::copy(records.begin(), records.end(), rest.begin());
  } else if (zstd_unpack(records, rest) != nullptr) {
    return {};
  }
  Findings ignored;
  return is_intact_head(out, ignored) ? out : Bytes();
}

// Returns whether the copy of a head with this header may be at [at, end).
bool is_copy_location(const FileHeader& header, std::uint64_t at, std::uint64_t end) {
  return (header.flags & kGrowing) != 0 ? at == header.head_bytes : end == header.file_bytes;
}

bool states_its_length(std::span<const std::uint8_t> payload) {
  return ByteReader(payload.last(kHeadLengthBytes)).u64() == payload.size();
}

bool is_copy(const RecordHeader& record) {
  return record.tag == kCopyTag && record.flags == 0 &&
         record.length >= kHeaderBytes + kHeadLengthBytes;
}

class Search {
 public:
  Search(const ByteSource& source, std::span<const std::uint8_t> first, const ReadLimits& limits)
      : source_(source), first_(first), stated_(intact_header(first)), limits_(limits) {}

  Result<FoundCopy> run() const {
    if (stated_ && (stated_->flags & kGrowing) != 0) return at(stated_->head_bytes);
    STGS_ASSIGN(FoundCopy found, before(stated_ ? stated_->file_bytes : source_.size()));
    if (found || stated_) return found;
    return after_records();
  }

 private:
  Result<FoundCopy> at(std::uint64_t offset) const {
    STGS_ASSIGN(const auto record, complete_record_at(source_, offset, source_.size()));
    if (!record || !is_copy(*record) || record->length > limits_.max_memory) return FoundCopy();
    Bytes payload(record->length);
    STGS_TRY(source_.read(offset + kRecordHeaderBytes, payload));
    if (checksum(payload) != record->checksum || !states_its_length(payload)) return FoundCopy();
    const std::optional<FileHeader> header = intact_header(payload);
    if (!header || header->head_bytes < kHeaderBytes ||
        header->head_bytes > std::min(source_.size(), limits_.max_memory)) {
      return FoundCopy();
    }
    const std::uint64_t end = offset + kRecordHeaderBytes + record->length;
    const bool growing = (header->flags & kGrowing) != 0;
    const bool own = stated_ ? std::equal(first_.begin(), first_.end(), payload.begin())
                             : header->file_bytes == (growing ? 0 : source_.size());
    if (!own || !is_copy_location(*header, offset, end)) return FoundCopy();
    Bytes head = unpack_copy(payload, *header);
    return head.empty() ? FoundCopy() : FoundCopy({offset, std::move(head)});
  }

  // Finds the copy that ends at `end`.
  Result<FoundCopy> before(std::uint64_t end) const {
    constexpr std::uint64_t kMinBytes = kRecordHeaderBytes + kHeaderBytes + kHeadLengthBytes;
    if (end > source_.size() || end < kMinBytes) return FoundCopy();
    Bytes bytes(kHeadLengthBytes);
    STGS_TRY(source_.read(end - kHeadLengthBytes, bytes));
    const std::uint64_t length = ByteReader(bytes).u64();
    if (length > end - kRecordHeaderBytes) return FoundCopy();
    return at(end - kRecordHeaderBytes - length);
  }

  // Finds the copy of a growing file whose header is damaged: the length of its head is unknown.
  Result<FoundCopy> after_records() const {
    std::uint64_t offset = kHeaderBytes;
    for (int passed = 0; passed <= kMaxRecordsBefore; ++passed) {
      STGS_ASSIGN(const auto record, complete_record_at(source_, offset, source_.size()));
      if (!record || record->tag == kSegmentTag || record->tag == kFragmentTag) break;
      if (record->tag == kCopyTag) return at(offset);
      offset += kRecordHeaderBytes + record->length;
    }
    return FoundCopy();
  }

  const ByteSource& source_;
  const std::span<const std::uint8_t> first_;
  const std::optional<FileHeader> stated_;  // set if the header is intact
  const ReadLimits& limits_;
};

}  // namespace

Result<FoundCopy> find_head_copy(const ByteSource& source, std::span<const std::uint8_t> first,
                                 const ReadLimits& limits) {
  return Search(source, first, limits).run();
}

Result<std::uint64_t> end_of_head_copy(const ByteSource& source, const FileHeader& header) {
  STGS_ASSIGN(const auto record, complete_record_at(source, header.head_bytes, source.size()));
  if (!record || !is_copy(*record)) return header.head_bytes;
  return header.head_bytes + kRecordHeaderBytes + record->length;
}

void check_head_copy(const ByteSource& source, const FileHead& head, std::uint64_t at,
                     std::span<const std::uint8_t> payload, Findings& findings) {
  if (!is_copy_location(head.header, at, at + kRecordHeaderBytes + payload.size())) {
    return findings.warning(N::kForeignCopy, at, "head copy at an unused position");
  }
  const Result<Bytes> own = read_head_bytes(source, head);
  if (!own.ok()) return findings.failed_read(0, own.status());
  const bool same = payload.size() >= kHeaderBytes + kHeadLengthBytes &&
                    states_its_length(payload) &&
                    std::equal(own->begin(), own->begin() + kHeaderBytes, payload.begin()) &&
                    unpack_copy(payload, head.header) == *own;
  if (!same) findings.warning(N::kForeignCopy, at, "head copy does not match this file's head");
}

}  // namespace stgs
