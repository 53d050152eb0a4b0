// SPDX-License-Identifier: Apache-2.0
// Copies of a head, in case the head is damaged (spec 10.2).
#include <algorithm>

#include "container/node.h"
#include "core/read_bytes.h"

namespace stgs {
namespace {

using N = IssueNumber;
using Bytes = std::vector<std::uint8_t>;
using FoundCopy = std::optional<HeadCopy>;

constexpr std::uint64_t kCopyLengthBytes = 8;  // at the end of the payload

// Finds the COPY record that ends a finished file.
Result<FoundCopy> copy_at_end(const ByteSource& source, const ReadLimits& limits) {
  const std::uint64_t end = source.size();
  if (end < head_copy_bytes(kHeaderBytes)) return FoundCopy();
  Bytes bytes(kCopyLengthBytes);
  STGS_TRY(source.read(end - kCopyLengthBytes, bytes));
  const std::uint64_t length = ByteReader(bytes).u64();
  if (length < kCopyLengthBytes || length > end - kRecordHeaderBytes) return FoundCopy();
  const std::uint64_t at = end - kRecordHeaderBytes - length;
  STGS_ASSIGN(const auto record, complete_record_at(source, at, end));
  if (!record || record->tag != kCopyTag || record->flags != 0 || record->length != length) {
    return FoundCopy();
  }
  if (length - kCopyLengthBytes > limits.max_memory) return FoundCopy({at, {}});
  STGS_TRY(read_bytes(source, at + kRecordHeaderBytes, length, bytes));
  if (checksum(bytes) != record->checksum) return FoundCopy();
  bytes.resize(length - kCopyLengthBytes);
  if (!is_usable_copy(bytes, false, end)) return FoundCopy();
  return FoundCopy({at, std::move(bytes)});
}

}  // namespace

bool is_intact_head(std::span<const std::uint8_t> head, HeadDamage which, Findings& findings) {
  for (std::uint64_t at = kHeaderBytes; at < head.size();) {
    RecordHeader record;
    if (!parse_record_header(head.subspan(at), at, head.size(), record, findings)) return false;
    at += kRecordHeaderBytes;
    const bool checked = which == HeadDamage::kAny || (record.flags & kCritical) != 0;
    if (checked && !check_payload(record, head.subspan(at, record.length), at, findings))
      return false;
    at += record.length;
  }
  return true;
}

bool is_usable_copy(std::span<const std::uint8_t> head, bool growing, std::uint64_t file_bytes) {
  const std::optional<FileHeader> header = intact_header(head);
  Findings ignored;
  return header && header->head_bytes == head.size() &&
         ((header->flags & kGrowing) != 0) == growing &&
         (growing || header->file_bytes == file_bytes) &&
         is_intact_head(head, HeadDamage::kAny, ignored);
}

Result<FoundCopy> find_head_copy(const ByteSource& source, const ReadLimits& limits) {
  STGS_ASSIGN(FoundCopy found, copy_at_end(source, limits));
  if (found) return found;
  FileHead none;
  none.limits = limits;
  none.available_bytes = source.size();
  none.header.flags = kGrowing;
  STGS_ASSIGN(FragmentFinder::Found last, FragmentFinder(source, none, none.walk.search).last());
  if (!last) return FoundCopy();
  return FoundCopy({last->offset, std::move(last->head)});
}

void check_head_copy(const FileHead& head, std::uint64_t at, std::span<const std::uint8_t> payload,
                     Findings& findings) {
  const std::uint64_t end = at + kRecordHeaderBytes + payload.size();
  if (head.growing() || end != head.header.file_bytes) {
    return findings.warning(N::kForeignCopy, at, "head copy at an unused position");
  }
  const std::size_t size = payload.size() - std::min<std::size_t>(payload.size(), kCopyLengthBytes);
  const bool same = ByteReader(payload.subspan(size)).u64() == payload.size() &&
                    std::equal(payload.begin(), payload.begin() + static_cast<std::ptrdiff_t>(size),
                               head.bytes->begin(), head.bytes->end());
  if (!same) findings.warning(N::kForeignCopy, at, "head copy does not match this file's head");
}

}  // namespace stgs
