// SPDX-License-Identifier: Apache-2.0
// Clauses 2 and 3: header, records and head.
#include <xxhash.h>

#include <algorithm>
#include <set>

#include "interchange/stgs1/file.h"
#include "interchange/stgs1/stgs1.h"

namespace stgs::stgs1 {
namespace {

constexpr std::uint32_t kCriticalHeaderFlags = 0xFFFF;  // 2.4
constexpr std::uint32_t kGrowingFlag = 1;

bool is_critical_tag(std::uint32_t t) {  // 3.2
  return t == tag("META") || t == tag("LAYT") || t == tag("INDX") || t == tag("FRAG") ||
         t == tag("SEGM");
}

// Checks the fields of a header and copies them (2.3 to 2.6).
Status take_header(const Header& header, File& file) {
  const std::uint64_t size = file.source.size();
  if (header.major != 1) {
    return unsupported("format version {}.{} is not 1.x", header.major, header.minor);
  }
  if ((header.flags & kCriticalHeaderFlags & ~kGrowingFlag) != 0) {
    return unsupported("the header has unknown critical flags {:#x}", header.flags);
  }
  const std::uint64_t limit = header.is_growing() ? size : header.file_bytes;
  if (header.head_bytes < kHeader || header.head_bytes > std::min(limit, size) ||
      (header.is_growing() && header.file_bytes != 0)) {
    return invalid_file(
        "the file is truncated within its head, or its header states invalid sizes (file: {} "
        "bytes, head: {} bytes; the file has {} bytes); copy or download it again",
        header.file_bytes, header.head_bytes, size);
  }
  file.minor = header.minor;
  file.is_growing = header.is_growing();
  file.head_bytes = header.head_bytes;
  file.end = header.is_growing() ? size : header.file_bytes;
  if (size != file.end) {
    file.damage.push_back(
        fmt::format("the file has {} bytes instead of {}; copy or download it "
                    "again",
                    size, file.end));
  }
  return {};
}

// Reads the head, or its copy if it is damaged.
Status read_or_repair(File& file, ChargedBytes& head) {
  const std::uint64_t size = file.source.size();
  Bytes first;
  STGS_TRY(read_bytes(file.source, 0, std::min(size, kHeader), first));
  if (first.size() < kHeader) {
    return invalid_file("too short for an .stgs file (expected at least {} bytes, got {})", kHeader,
                        size);
  }
  std::optional<Header> header = valid_header(first);
  if (header && header->major != 1) return take_header(*header, file);
  bool is_damaged = !header;
  if (header && header->head_bytes >= kHeader && header->head_bytes <= size) {
    STGS_ASSIGN(head.lease, file.memory.take(header->head_bytes, "the bytes of the head"));
    STGS_TRY(read_bytes(file.source, 0, header->head_bytes, head.value));
    is_damaged = !is_intact_head(head.value);
  }
  std::optional<ChargedBytes> copy;
  if (is_damaged) {
    STGS_ASSIGN(copy, find_head_copy(file, first));
  }
  if (copy) {
    head = std::move(*copy);
    header = valid_header(head.value);
    file.damage.push_back("the head is damaged and was read from its copy");
  }
  if (header) return take_header(*header, file);
  return invalid_file("{}; copy or download the file again",
                      is_stgs1(first) ? "the header is damaged and has no usable copy"
                                      : "not an .stgs file of version 1, or a damaged one");
}

// The records of a head that are read (2.3).
struct HeadRecords {
  std::set<std::uint32_t> have;
  View layouts, index;
};

Status check_sum(const Record& record, View payload) {
  if (checksum(payload) == record.checksum) return {};
  return invalid_file("record '{}' is damaged; copy or download the file again [byte {}]",
                      text_of(record.tag), record.offset);
}

// Reads WNDW or PRIV.
Status read_aside(const Record& record, View payload, HeadRecords& records, File& file) {
  STGS_TRY(check_sum(record, payload));
  if (records.have.count(record.tag) != 0) {
    return invalid_file("the head has two '{}'", text_of(record.tag));
  }
  STGS_TRY(record.tag == tag("WNDW") ? read_window(payload, file.metadata)
                                     : check_private_names(payload));
  records.have.insert(record.tag);
  return {};
}

Status read_head_record(const Record& record, View payload, HeadRecords& records, File& file) {
  const std::uint32_t t = record.tag;
  if ((t == tag("WNDW") || t == tag("PRIV")) && record.flags == 0) {
    const Status status = read_aside(record, payload, records, file);  // errors are reported, 3.4
    if (!status.ok()) file.damage.push_back("ignored a record: " + status.message());
    return {};
  }
  const bool is_known =
      t == tag("META") || t == tag("LAYT") || (t == tag("INDX") && !file.is_growing);
  if (!is_known || record.flags != kCriticalFlag) {  // 3.2, 3.4
    if ((record.flags & kCriticalFlag) != 0) {
      return unsupported("the head has an unknown critical record '{}' (flags {:#x})", text_of(t),
                         record.flags);
    }
    if (is_critical_tag(t) && record.flags == 0) {
      return invalid_file("record '{}' is not marked critical", text_of(t));
    }
    file.omit(fmt::format("record '{}'", text_of(t)), kRecord + record.length);
    return {};
  }
  STGS_TRY(check_sum(record, payload));
  if (!records.have.insert(t).second) return invalid_file("the head has two '{}'", text_of(t));
  if (t == tag("META")) return read_metadata(payload, file);
  if (t == tag("INDX") && records.have.count(tag("META")) == 0) {
    return invalid_file("the head has INDX before META");
  }
  (t == tag("LAYT") ? records.layouts : records.index) = payload;
  return {};
}

Status read_head(View head, File& file) {
  HeadRecords records;
  for (std::uint64_t at = kHeader; at < head.size();) {
    const std::optional<Record> record = parse_record(head.subspan(at), at, head.size());
    if (!record) return invalid_file("the head has a damaged record [byte {}]", at);
    STGS_TRY(
        read_head_record(*record, head.subspan(record->payload(), record->length), records, file));
    at = record->end();
  }
  if (records.have.count(tag("META")) == 0 ||
      (records.have.count(tag("INDX")) == 0 && !file.is_growing)) {
    return invalid_file("the head has no META or no INDX");
  }
  if (records.have.count(tag("LAYT")) != 0) {
    ByteReader in(records.layouts);
    STGS_TRY(read_layouts(in, file.memory, 1024, file.layouts, file.layouts_lease));
  }
  if (file.is_growing) return read_fragments(file, checksum(head));
  file.body_at = file.head_bytes;
  return read_index(records.index, file.head_bytes, file.end, file);
}

}  // namespace

std::string text_of(std::uint32_t tag) {
  std::string text;
  for (int i = 0; i < 4; ++i) {
    const auto c = static_cast<char>(tag >> 8 * i & 0xFF);
    text.push_back(c >= 0x20 && c < 0x7F ? c : '.');
  }
  return text;
}

std::uint64_t checksum(View bytes) {
  return XXH3_64bits(bytes.data(), bytes.size());
}

Status read_bytes(const ByteSource& source, std::uint64_t offset, std::uint64_t count, Bytes& out) {
  STGS_TRY(check_range(source.name(), source.size(), offset, count));
  out.resize(static_cast<std::size_t>(count));
  return source.read(offset, out);
}

std::optional<Header> valid_header(View bytes) {
  if (bytes.size() < kHeader || !std::equal(kFileMagic.begin(), kFileMagic.end(), bytes.begin())) {
    return {};
  }
  ByteReader in(bytes.subspan(kFileMagic.size()));
  Header header;
  header.major = in.u16();
  header.minor = in.u16();
  header.flags = in.u32();
  header.file_bytes = in.u64();
  header.head_bytes = in.u64();
  if (in.u64() != checksum(bytes.first(kHeader - 8))) return {};
  return header;
}

std::optional<Record> parse_record(View bytes, std::uint64_t offset, std::uint64_t end) {
  if (bytes.size() < kRecord || offset > end || end - offset < kRecord) return {};
  ByteReader in(bytes);
  Record record;
  record.offset = offset;
  record.tag = in.u32();
  record.flags = in.u32();
  record.length = in.u64();
  record.checksum = in.u64();
  const bool is_valid =
      in.u64() == checksum(bytes.first(kRecord - 8)) && record.length <= end - offset - kRecord;
  return is_valid ? std::optional(record) : std::nullopt;
}

Result<std::optional<Record>> record_at(const ByteSource& source, std::uint64_t offset,
                                        std::uint64_t end) {
  const std::uint64_t available = std::min(end, source.size());
  if (offset > available || available - offset < kRecord) return std::optional<Record>();
  Bytes bytes;
  STGS_TRY(read_bytes(source, offset, kRecord, bytes));
  return parse_record(bytes, offset, end);
}

bool is_intact_head(View head) {
  for (std::uint64_t at = kHeader; at < head.size();) {
    const std::optional<Record> record = parse_record(head.subspan(at), at, head.size());
    if (!record || checksum(head.subspan(record->payload(), record->length)) != record->checksum) {
      return false;
    }
    at = record->end();
  }
  return true;
}

Status open_stgs1(File& file) {
  ChargedBytes head;
  STGS_TRY(read_or_repair(file, head));
  STGS_TRY(read_head(head.value, file));
  SceneMetadata& scene = file.metadata;
  if (scene.window && std::uint64_t{scene.window->first_frame} + scene.frames >
                          scene.window->capture_frames) {  // 4.5
    file.damage.push_back("ignored a training window that exceeds its capture");
    scene.window.reset();
  }
  return file.memory.check_count(file.primitives);
}

}  // namespace stgs::stgs1
