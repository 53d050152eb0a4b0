// SPDX-License-Identifier: Apache-2.0
// Content of a file that a Scene cannot represent.
#include <algorithm>
#include <exception>
#include <map>
#include <mutex>
#include <set>

#include "container/segment.h"
#include "core/bytes.h"
#include "stgs/format/damage_report.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

constexpr std::uint64_t kMaxNameBytes = 256;  // longer names are not shown

// Makes a name from the file safe for a line of text.
std::string in_line(std::string name) {
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return c < 0x20 || c == 0x7F; }, '?');
  return name;
}

std::string private_name(const FileHead& head, PrivateKind kind, int number) {
  for (const PrivateName& name : head.private_names) {
    if (name.kind == kind && name.number == number) return " (" + in_line(name.name) + ")";
  }
  return "";
}

// Returns the text at the beginning of `in`, quoted; "" if it is incomplete.
std::string quoted(ByteReader in) {
  const std::string text = in.string();
  return in.ok() && !text.empty() ? " '" + in_line(text) + "'" : "";
}

class Extras {
 public:
  Extras(const ByteSource& source, FileHead& head) : source_(source), head_(head) {}

  Result<std::vector<std::string>> find() {
    STGS_TRY(find_further());
    const std::unique_ptr<ByteSource> in_head = memory_source(*head_.bytes);
    STGS_TRY(find_records(*in_head, kHeaderBytes, head_.header.head_bytes));
    std::uint64_t at = head_.header.head_bytes;
    for (const RecordRange* record : records_of(head_.index)) {
      STGS_TRY(find_records(source_, at, record->offset));
      at = std::max(at, record->offset + record->bytes);
    }
    STGS_TRY(find_records(source_, at, std::min(head_.header.file_bytes, head_.available_bytes)));
    find_attributes();
    if (head_.metadata.profile_number >= kFirstPrivate) {
      lines_.push_back(
          fmt::format("private profile {:#x}{}", head_.metadata.profile_number,
                      private_name(head_, PrivateKind::kProfile, head_.metadata.profile_number)));
    }
    for (const auto& [name, total] : found_) {
      lines_.push_back(fmt::format("{}: {} {}, {} bytes", name, total.records,
                                   total.records == 1 ? "record" : "records", total.bytes));
    }
    return std::move(lines_);
  }

 private:
  static constexpr int kFirstPrivate = 0xC000;
  struct Total {
    std::uint64_t records = 0, bytes = 0;
  };

  void count(const std::string& name, std::uint64_t bytes) {
    Total& total = found_[name];
    ++total.records;
    total.bytes += bytes;
  }

  // Finds further records of segments (spec 5.7).
  Status find_further() {
    for (const FurtherEntry& further : head_.index.further) {
      const IndexEntry& entry = further.entry;
      if (!head_.has(entry) || is_ends(entry)) continue;
      const int content = content_of(entry.layer);
      constexpr std::uint64_t kBefore = kRecordHeaderBytes + 8 + 2 * 8;
      std::vector<std::uint8_t> bytes(std::min(entry.bytes, kBefore + kMaxNameBytes));
      STGS_TRY(source_.read(entry.offset, bytes));
      std::string kind;
      if (content >= kFirstPrivateContent && bytes.size() > kBefore) {
        kind = quoted(ByteReader(std::span<const std::uint8_t>(bytes).subspan(kBefore)));
      }
      count(fmt::format("further records{} of content {}{}", kind, content,
                        private_name(head_, PrivateKind::kContent, content)),
            entry.bytes);
    }
    return {};
  }

  // Finds non-critical records, except those that a Scene represents.
  Status find_records(const ByteSource& source, std::uint64_t at, std::uint64_t end) {
    while (at < end && end - at >= kRecordHeaderBytes) {
      std::vector<std::uint8_t> bytes(std::min(end - at, kRecordHeaderBytes + kMaxNameBytes));
      STGS_TRY(source.read(at, bytes));
      Findings damaged;
      RecordHeader record;
      if (!parse_record_header(bytes, at, end, record, damaged)) break;
      const std::uint64_t size = kRecordHeaderBytes + record.length;
      const bool ours = record.tag == kWindowTag || record.tag == kPrivateTag ||
                        record.tag == kImportanceTag || record.tag == kStepTag ||
                        record.tag == kErrorTag || record.tag == kCopyTag;
      if ((record.flags & kCritical) == 0 && !ours) {
        const auto payload = std::span<const std::uint8_t>(bytes).subspan(
            kRecordHeaderBytes, std::min<std::uint64_t>(record.length, kMaxNameBytes));
        const bool is_private = (record.tag & 0x20) != 0;  // first letter is lower case, spec 3.5
        count(fmt::format("'{}'{}", tag_text(record.tag),
                          is_private ? quoted(ByteReader(payload)) : std::string()),
              size);
      }
      at += size;
    }
    return {};
  }

  // Finds optional and private streams in the layouts of the file and of records (spec 6.2).
  void find_attributes() {
    std::set<std::uint16_t> found;
    std::mutex mutex;
    const auto take = [&found](const LayoutSet& set) {
      for (const Layout& layout : set.layouts) {
        for (const StreamRow& row : layout.streams) {
          if (row.optional()) found.insert(row.attribute);
        }
      }
    };
    take(*head_.layouts);
    parallel_for(std::size_t{0}, head_.index.segments.size(), [&](std::size_t i) {
      Findings damaged;
      SegmentRecords records;
      read_segment(source_, head_, static_cast<std::uint32_t>(i), true, records, damaged);
      const std::lock_guard lock(mutex);
      take(records.base.own);
      take(records.sh.own);
    });
    for (const std::uint16_t attribute : found) {
      lines_.push_back(fmt::format("primitive attribute {:#x}{}", attribute,
                                   private_name(head_, PrivateKind::kAttribute, attribute)));
    }
  }

  const ByteSource& source_;
  FileHead& head_;
  std::map<std::string, Total> found_;
  std::vector<std::string> lines_;
};

}  // namespace

Result<std::vector<std::string>> scene_extras(const std::string& path, const ReadLimits& limits) {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_file(path));
  try {
    Findings findings;
    FileHead head;
    read_head(*source, limits, IndexLoading::kComplete, head, findings);
    if (!findings.ok()) return findings.status(path);
    return Extras(*source, head).find();
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: {}", path, e.what()));
  }
}

}  // namespace stgs
