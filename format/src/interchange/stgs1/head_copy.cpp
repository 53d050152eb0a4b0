// SPDX-License-Identifier: Apache-2.0
// Clause 3.6: the copy of a damaged head.
#include <algorithm>

#include "interchange/stgs1/file.h"

namespace stgs::stgs1 {
namespace {

constexpr int kMaxSkipped = 64;    // records before the copy
constexpr std::uint64_t kSum = 8;  // the length that ends the payload
constexpr std::uint64_t kMinPayload = kHeader + kSum;
using Found = std::optional<ChargedBytes>;

class CopySearch {
 public:
  CopySearch(const File& file, View first)
      : source_(file.source), memory_(file.memory), first_(first), stated_(valid_header(first)) {}

  Result<Found> run() const {
    if (!stated_) {
      STGS_ASSIGN(Found found, ending_at(source_.size()));
      if (found) return found;
      return after_records();
    }
    return stated_->is_growing() ? at(stated_->head_bytes) : ending_at(stated_->file_bytes);
  }

 private:
  // Returns the head in the record at `offset`, if it is a usable copy.
  Result<Found> at(std::uint64_t offset) const {
    STGS_ASSIGN(const std::optional<Record> record, record_at(source_, offset, source_.size()));
    if (!record || record->tag != tag("COPY") || record->flags != 0 ||
        record->length < kMinPayload) {
      return Found();
    }
    STGS_ASSIGN(const Lease lease, memory_.take(record->length, "the bytes of the copied head"));
    Bytes payload;
    STGS_TRY(read_bytes(source_, record->payload(), record->length, payload));
    const View bytes(payload);
    const std::optional<Header> header = valid_header(bytes);
    if (checksum(bytes) != record->checksum || !header ||
        ByteReader(bytes.last(kSum)).u64() != record->length) {
      return Found();
    }
    const std::uint64_t file_bytes = header->is_growing() ? 0 : source_.size();
    const bool is_own = stated_ ? std::equal(first_.begin(), first_.end(), bytes.begin())
                                : header->file_bytes == file_bytes;
    const bool is_in_position =
        header->is_growing() ? offset == header->head_bytes : record->end() == header->file_bytes;
    if (!is_own || !is_in_position || header->head_bytes < kHeader ||
        header->head_bytes > source_.size()) {
      return Found();
    }
    return head_of(bytes, header->head_bytes);
  }

  Result<Found> head_of(View payload, std::uint64_t head_bytes) const {
    const View stored = payload.subspan(kHeader, payload.size() - kMinPayload);
    if (!check_stored(stored, head_bytes - kHeader).ok()) return Found();
    ChargedBytes head;
    STGS_ASSIGN(head.lease, memory_.take(head_bytes + kZstdScratch, "the bytes of the head"));
    head.value.reserve(static_cast<std::size_t>(head_bytes));
    head.value.assign(payload.begin(), payload.begin() + kHeader);
    head.value.resize(static_cast<std::size_t>(head_bytes));
    const bool is_intact =
        unpack(stored, std::span(head.value).subspan(kHeader)).ok() && is_intact_head(head.value);
    return is_intact ? Found(std::move(head)) : Found();
  }

  Result<Found> ending_at(std::uint64_t end) const {
    if (end > source_.size() || end < kRecord + kMinPayload) return Found();
    Bytes bytes;
    STGS_TRY(read_bytes(source_, end - kSum, kSum, bytes));
    const std::uint64_t length = ByteReader(bytes).u64();
    if (length > end - kRecord) return Found();
    return at(end - kRecord - length);
  }

  // Follows the records of a head whose header is damaged.
  Result<Found> after_records() const {
    std::uint64_t offset = kHeader;
    for (int i = 0; i <= kMaxSkipped; ++i) {
      STGS_ASSIGN(const std::optional<Record> record, record_at(source_, offset, source_.size()));
      if (!record || record->tag == tag("SEGM") || record->tag == tag("FRAG")) break;
      if (record->tag == tag("COPY")) return at(offset);
      offset = record->end();
    }
    return Found();
  }

  const ByteSource& source_;
  ImportMemory& memory_;
  View first_;
  std::optional<Header> stated_;
};

}  // namespace

Result<std::optional<ChargedBytes>> find_head_copy(const File& file, View first) {
  return CopySearch(file, first).run();
}

}  // namespace stgs::stgs1
