// SPDX-License-Identifier: Apache-2.0
// Reading the headers of records, and checking records (spec 3).
#include "container/container.h"

namespace stgs {

namespace {

using N = IssueNumber;

// Returns whether records with this tag must be marked critical (spec 3.3).
bool is_critical(std::uint32_t tag) {
  return tag == kMetadataTag || tag == kLayoutTag || tag == kIndexTag || tag == kPageTag ||
         tag == kFragmentTag || tag == kSegmentTag;
}

}  // namespace

std::string tag_text(std::uint32_t tag) {
  std::string text;
  for (int i = 0; i < 4; ++i) {
    const auto c = static_cast<char>(tag >> (8 * i) & 0xFF);
    text.push_back(c >= 0x20 && c < 0x7F ? c : '.');
  }
  return text;
}

bool parse_record_header(std::span<const std::uint8_t> bytes, std::uint64_t offset,
                         std::uint64_t area_end, RecordHeader& header, Findings& findings) {
  if (bytes.size() < kRecordHeaderBytes || area_end - offset < kRecordHeaderBytes) {
    findings.error(N::kRecordHeader, offset, "truncated record header");
    return false;
  }
  ByteReader in(bytes);
  header.tag = in.u32();
  header.flags = in.u32();
  header.length = in.u64();
  header.checksum = in.u32();
  if (in.u32() != checksum(bytes.first(kRecordHeaderBytes - 4))) {
    findings.error(N::kRecordHeader, offset, "header of record '{}' is damaged (checksum mismatch)",
                   tag_text(header.tag));
    return false;
  }
  if (header.length > area_end - offset - kRecordHeaderBytes) {
    findings.error(N::kRecordLength, offset, "record '{}' of {} bytes extends past byte {}",
                   tag_text(header.tag), header.length, area_end);
    return false;
  }
  return true;
}

Result<std::optional<RecordHeader>> complete_record_at(const ByteSource& source,
                                                       std::uint64_t offset, std::uint64_t end) {
  std::optional<RecordHeader> none;
  if (offset > end || end - offset < kRecordHeaderBytes) return none;
  std::vector<std::uint8_t> bytes(kRecordHeaderBytes);
  STGS_TRY(source.read(offset, bytes));
  Findings ignored(Findings::Texts::kNone);
  RecordHeader header;
  if (!parse_record_header(bytes, offset, end, header, ignored)) return none;
  return std::optional(header);
}

bool check_flags(const RecordHeader& header, bool known_tag, std::uint64_t offset,
                 Findings& findings) {  // spec 3.3, 3.4
  if (known_tag && header.flags == kCritical) return true;
  if ((header.flags & kCritical) != 0) {
    findings.unsupported(N::kUnknownCritical, offset,
                         "unknown critical record '{}' (flags {:#x}); a later version is needed",
                         tag_text(header.tag), header.flags);
  } else if (known_tag || is_critical(header.tag)) {
    findings.error(N::kNotCritical, offset, "record '{}' is not marked critical",
                   tag_text(header.tag));
  }
  return false;
}

bool check_payload(const RecordHeader& header, std::span<const std::uint8_t> payload,
                   std::uint64_t offset, Findings& findings) {
  if (checksum(payload) == header.checksum) return true;
  findings.error(N::kRecordChecksum, offset,
                 "record '{}' is damaged (checksum mismatch over {} bytes)", tag_text(header.tag),
                 payload.size());
  return false;
}

}  // namespace stgs
