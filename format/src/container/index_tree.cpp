// SPDX-License-Identifier: Apache-2.0
// Following the links of an index, as far as its segments are needed (spec 5.2, 9.3, 9.5).
#include <algorithm>
#include <map>
#include <utility>

#include "container/node.h"
#include "container/opening.h"
#include "core/read_bytes.h"

namespace stgs {
namespace {

using N = IssueNumber;

using Position = IndexWalk::Links::const_iterator;

// Adds links as pending ones before `next`, except those that were followed.
void add_links(std::span<const NodeLink> links, int depth, Position next, FileHead& head) {
  for (const NodeLink& link : links) {
    if (head.walk.followed.count(link.offset) == 0) head.walk.pending.insert(next, {link, depth});
  }
}

// Counts entries of the index (conformance 1.5).
bool take_entries(std::uint64_t count, std::uint64_t at, FileHead& head, Findings& findings) {
  head.walk.entries += count;
  const std::uint64_t limit = head.limits.max_memory;
  if (head.walk.entries <= kFreeEntries || head.walk.entries - kFreeEntries <= limit / kEntryMemory)
    return fits_opening(head, 0, 0, at, findings);
  findings.unsupported(N::kMemoryLimit, at, "index: {} entries exceed the memory limit of {} bytes",
                       head.walk.entries, limit);
  return false;
}

// Returns the index of a part, which is added if it is new.
std::uint32_t take_part(const PartEntry& part, FileHead& head) {
  auto& parts = head.walk.parts;  // usually added in their order
  const auto number = static_cast<std::uint32_t>(head.parts.size());
  const auto found = parts.try_emplace(parts.end(), part, number);
  if (parts.size() > head.parts.size()) head.parts.push_back(part);
  return found->second;
}

// Notes that a link to a record was followed; usually they are in the order of the file. Returns
// false if one was before.
bool take_record(std::uint64_t offset, FileHead& head) {
  const std::size_t before = head.walk.followed.size();
  head.walk.followed.insert(head.walk.followed.end(), offset);
  return head.walk.followed.size() > before;
}

// Moves entries to the end of a list.
template <typename Entry>
void append(std::vector<Entry>& more, std::vector<Entry>& entries) {
  if (entries.empty()) {
    entries = std::move(more);
    return;
  }
  make_room(more.size(), entries);
  entries.insert(entries.end(), more.begin(), more.end());
}

// Adds a pending link before `next` to each record of ends of a node.
void add_end_links(const IndexNode& node, Position next, FileHead& head) {
  for (const FurtherEntry& further : node.further) {
    const IndexEntry& entry = further.entry;
    if (!is_ends(entry)) continue;
    const TickRange needed = needed_of(entry, head.parts[further.part]);
    if (needed.begin > needed.end) continue;
    const NodeLink link = {needed, entry.offset, 0, entry.bytes - kRecordHeaderBytes};
    head.walk.pending.insert(next, {link, 0, further});
  }
}

// Adds the segments and further records of a node, and pending links before `next`.
void add_entries(IndexNode& node, Position next, FileHead& head) {
  std::size_t s = 0, f = 0;
  for (const IndexRun& run : node.runs) {
    const std::uint32_t part = take_part(run.part, head), first = head.walk.segments;
    const auto complete = [=](auto& entry) {
      entry.part = part;
      entry.number += first;
    };
    for (const std::size_t end = s + run.segments; s < end; ++s) complete(node.segments[s]);
    for (const std::size_t end = f + run.further; f < end; ++f) complete(node.further[f]);
    head.walk.segments += run.count;
  }
  add_end_links(node, next, head);
  append(node.segments, head.index.segments);
  append(node.further, head.index.further);
}

// Returns whether a record lies within the bytes that are there.
bool is_complete(std::uint64_t at, std::uint64_t bytes, const FileHead& head) {
  return at <= head.available_bytes && bytes <= head.available_bytes - at;
}

// Checks that records together have at most the bytes of the file; otherwise they overlap.
bool fits(std::uint64_t bytes, const char* what, std::uint64_t at, const FileHead& head,
          Findings& findings) {
  if (bytes <= head.available_bytes) return true;
  findings.unsupported(N::kMemoryLimit, at, "{} of {} bytes in a file of {} bytes overlap", what,
                       bytes, head.available_bytes);
  return false;
}

bool take_complete(std::uint64_t at, std::uint64_t payload, FileHead& head, Findings& findings) {
  head.walk.complete_bytes += payload;
  return fits(head.walk.complete_bytes, "nodes", at, head, findings);
}

// Counts the entries of a node, their primitives and the payloads of their records (conformance
// 1.5).
bool take_content(const IndexNode& node, std::uint64_t at, FileHead& head, Findings& findings) {
  std::uint64_t entries = node.links.size(), bytes = head.walk.record_bytes;
  const auto take = [&](const RecordRange& entry) {
    if (entry.bytes == 0) return;
    ++head.walk.records;
    if (is_complete(entry.offset, entry.bytes, head)) bytes += entry.bytes - kRecordHeaderBytes;
  };
  for (const IndexRun& run : node.runs) entries += run.count;
  entries += node.segments.size() + node.further.size();
  for (const SegmentEntry& segment : node.segments) {
    head.listed_primitives += segment.base.primitives;
    take(segment.base);
    take(segment.sh);
  }
  for (const FurtherEntry& further : node.further) take(further.entry);
  head.walk.record_bytes = bytes;
  head.walk.opening_bytes += opening_bytes(node);
  if (!take_entries(entries, at, head, findings)) return false;
  if (head.listed_primitives <= head.limits.max_primitives)
    return fits(bytes, "records", at, head, findings);
  findings.unsupported(N::kPrimitiveLimit, at, "index: {} primitives exceed the limit of {}",
                       head.listed_primitives, head.limits.max_primitives);
  return false;
}

// Loads nodes beyond the root.
class Loader {
 public:
  Loader(const ByteSource& source, FileHead& head, Findings& findings)
      : source_(source),
        head_(head),
        findings_(findings),
        fragments_(source, head, head.walk.search) {}

  // Loads the nodes with segments that are needed at times of [t0, t1].
  bool load(double t0, double t1) {
    IndexWalk::Links& pending = head_.walk.pending;
    for (Position next = pending.begin(); next != pending.end();) {
      const NodeLink& link = next->link;
      if (head_.walk.followed.count(link.offset) != 0) {
        next = pending.erase(next);
      } else if (link.needed.begin <= t1 && t0 <= link.needed.end) {
        if (!take(next)) return false;
      } else {
        ++next;
      }
    }
    return true;
  }

  // Loads available nodes until the index has `entries` entries: first the nodes needed at `ticks`
  // or soonest after it, then earlier ones.
  bool load_ahead(double ticks, std::uint64_t entries) {
    IndexWalk::Links& pending = head_.walk.pending;
    // Equal ones in the order of `pending`.
    std::multimap<std::pair<bool, double>, Position> order;
    for (auto link = pending.begin(); link != pending.end(); ++link) {
      if (!source_.has(link->link.offset, kRecordHeaderBytes + link->link.bytes)) continue;
      const TickRange& needed = link->link.needed;
      const bool is_past = needed.end < ticks;
      order.emplace(std::pair(is_past, is_past ? -needed.end : needed.begin), link);
    }
    for (auto [key, at] : order) {
      if (head_.walk.entries >= entries) break;
      const NodeLink& link = at->link;
      if (head_.walk.followed.count(link.offset) != 0) continue;
      if (!take(at)) return false;
    }
    return true;
  }

 private:
  // Follows a pending link and removes it. Returns in `at` the first link that it adds, or the one
  // after it.
  bool take(Position& at) {
    IndexWalk::Links& pending = head_.walk.pending;
    const auto [link, depth, ends] = *at;
    if (!ends) take_record(link.offset, head_);
    const bool is_first = at == pending.begin();
    next_ = pending.erase(at);
    const Position before = is_first ? next_ : std::prev(next_);
    if (!(ends ? load_ends(source_, *ends, head_, findings_) : follow(link, depth))) return false;
    at = is_first ? pending.begin() : std::next(before);
    return true;
  }

  bool follow(const NodeLink& link, int depth) {
    if (depth <= kMaxLinkDepth) {
      if (!take_node(link.offset, link.bytes, head_, findings_)) return false;
      return head_.growing() ? follow_fragment(link, depth) : follow_page(link, depth);
    }
    lose(link, lost_by(link), N::kLink,
         fmt::format("more than {} links follow each other", kMaxLinkDepth));
    return true;
  }

  static LostFragment lost_by(const NodeLink& link) {
    return {link.needed, link.offset, kRecordHeaderBytes + link.bytes};
  }

  // Reports content that only a damaged node lists.
  void lose(const NodeLink& link, const LostFragment& lost, N number, std::string_view why) {
    findings_.damage(number, link.offset, "index is damaged: {}; content listed only there is lost",
                     why);
    head_.lost_fragments.push_back(lost);
    head_.walk.lost.push_back({link.offset, static_cast<int>(number)});
  }

  bool follow_page(const NodeLink& link, int depth) {
    const auto is_there = [&](std::uint64_t at) {
      return is_complete(at, kRecordHeaderBytes + link.bytes, head_);
    };
    if (!is_there(link.offset) && (link.copy == 0 || !is_there(link.copy))) {
      lose(link, lost_by(link), N::kFileSize, kTruncated);
      return true;
    }
    ++head_.walk.pages;
    if (!fits_opening(head_, 0, 0, link.offset, findings_)) return false;
    std::vector<std::uint8_t> page;
    Findings why, ignored;
    const bool intact = read_page(link, link.offset, page, why);
    if (!intact) ++head_.walk.pages;
    if (!intact && !is_fatal(why) && link.copy != 0 && read_page(link, link.copy, page, ignored)) {
      findings_.damage(N::kRepairedHead, link.offset,
                       "index is damaged (issue {}) and was read from its copy at byte {}",
                       why.take().front().number, link.copy);
      why = {};
      if (!take_complete(link.copy, link.bytes, head_, findings_)) return false;
    }
    const std::uint64_t payload = link.offset + kRecordHeaderBytes;
    IndexNode node;
    if (why.ok()) {
      const std::span<const std::uint8_t> payload_bytes = page;
      ByteReader in(payload_bytes.subspan(kRecordHeaderBytes));
      const NodePlace place = {link.offset, payload, head_.header.head_bytes,
                               head_.header.file_bytes};
      parse_node(in, place, head_, node, why);
    }
    if (is_fatal(ignored)) return findings_.append(std::move(ignored)), false;
    if (is_fatal(why)) return findings_.append(std::move(why)), false;
    if (why.ok()) return add_node(std::move(node), link.offset, depth, next_, head_, findings_);
    const Issue reason = why.take().front();
    lose(link, lost_by(link), static_cast<N>(reason.number), reason.message);
    return true;
  }

  // Returns whether an error is that of the source or of a limit.
  static bool is_fatal(const Findings& findings) {
    return !findings.ok() && findings.status({}).code() != StatusCode::kInvalidFile;
  }

  // Reads the PAGE record at `at`, which is that of the link or its copy.
  bool read_page(const NodeLink& link, std::uint64_t at, std::vector<std::uint8_t>& page,
                 Findings& why) const {
    const std::uint64_t payload = at + kRecordHeaderBytes;
    const auto is_available = [&](std::uint64_t end) {
      if (end > head_.available_bytes) why.error(N::kFileSize, at, "{}", kTruncated);
      return end <= head_.available_bytes;
    };
    if (!is_available(payload + link.bytes)) return false;
    const Status status = read_bytes(source_, at, kRecordHeaderBytes + link.bytes, page);
    if (!status.ok()) why.failed_read(at, status);
    RecordHeader record;
    if (!status.ok() || !parse_record_header(page, at, head_.header.file_bytes, record, why)) {
      return false;
    }
    if (record.tag != kPageTag || record.flags != kCritical || record.length != link.bytes) {
      why.error(N::kPage, at, "record '{}' of {} bytes is no PAGE record of {} bytes",
                tag_text(record.tag), record.length, link.bytes);
      return false;
    }
    return check_payload(record, std::span(page).subspan(kRecordHeaderBytes), payload, why);
  }

  bool read(std::uint64_t at, std::span<std::uint8_t> bytes, Findings& why) const {
    const Status status = source_.read(at, bytes);
    if (!status.ok()) why.failed_read(at, status);
    return status.ok();
  }

  bool follow_fragment(const NodeLink& link, int depth) {
    Findings why;
    auto record = fragments_.at(link.offset, link.bytes, why);
    if (!record.ok()) return failed_search(link, record.status());
    if (*record) {
      return add_node(std::move((*record)->node), link.offset, depth, next_, head_, findings_);
    }
    const auto before = fragments_.last_before(link.offset);
    if (!before.ok()) return failed_search(link, before.status());
    LostFragment lost{link.needed, head_.header.head_bytes, 0};
    if (before->offset != 0) {  // content of a fragment is not needed before it begins (spec 9.6)
      lost.range.begin = std::max(lost.range.begin, static_cast<double>(before->frames));
      lost.range.end = std::max(lost.range.begin, lost.range.end);
      lost.offset = before->end;
    }
    lost.bytes = link.offset - std::min(lost.offset, link.offset);
    lose(link, lost, N::kFragment, why.take().front().message);
    return before->offset == 0 || follow_instead(link, before->offset, depth);
  }

  bool failed_search(const NodeLink& link, const Status& status) {
    findings_.failed_search(link.offset, status);
    return false;
  }

  // Follows the valid FRAG record at `offset` instead of that of a link (spec 9.5).
  bool follow_instead(const NodeLink& link, std::uint64_t offset, int depth) {
    const bool is_new = take_record(offset, head_);
    if (!is_new && head_.walk.used_earlier.count(offset) != 0) return true;
    Findings why;
    auto record = fragments_.at(offset, {}, why);
    if (!record.ok()) return failed_search(link, record.status());
    if (!*record) {  // the source changes while it is read
      findings_.append(std::move(why));
      return false;
    }
    FragmentRecord& fragment = **record;
    const std::uint64_t payload = fragment.end - offset - kRecordHeaderBytes;
    if (is_new && (!take_node(offset, payload, head_, findings_) ||
                   !add_node(std::move(fragment.node), offset, depth, next_, head_, findings_))) {
      return false;
    }
    return add_earlier(fragment, depth + 1, next_, head_, findings_);
  }

  static constexpr const char* kTruncated = "the file is truncated within a node of the index";

  const ByteSource& source_;
  FileHead& head_;
  Findings& findings_;
  FragmentFinder fragments_;
  Position next_;  // the link after the one that is followed
};

}  // namespace

bool take_node(std::uint64_t at, std::uint64_t payload, FileHead& head, Findings& findings) {
  IndexWalk& walk = head.walk;
  const std::uint64_t bytes = kRecordHeaderBytes + payload;
  walk.bytes += payload;
  head.index_bytes += bytes;
  if (walk.bytes > head.limits.max_memory) {
    findings.unsupported(N::kMemoryLimit, at, "index exceeds the memory limit of {} bytes",
                         head.limits.max_memory);
    return false;
  }
  return take_complete(at, is_complete(at, bytes, head) ? payload : 0, head, findings);
}

bool add_earlier(const FragmentRecord& fragment, int depth, Position next, FileHead& head,
                 Findings& findings) {
  if (!head.walk.used_earlier.insert(fragment.offset).second) return true;
  add_links(fragment.earlier, depth, next, head);
  head.walk.earlier.insert(head.walk.earlier.end(), fragment.earlier.begin(),
                           fragment.earlier.end());
  head.walk.opening_bytes += kOpeningLink * fragment.earlier.size();
  return take_entries(fragment.earlier.size(), fragment.offset, head, findings);
}

bool add_node(IndexNode node, std::uint64_t record, int depth, Position next, FileHead& head,
              Findings& findings) {
  add_links(node.links, depth + 1, next, head);
  if (!take_content(node, record, head, findings)) return false;
  const TickRange needed =
      head.walk.keeps_nodes ? needed_in(node, head.metadata.scene.frames) : TickRange{};
  add_entries(node, next, head);
  if (head.walk.keeps_nodes)
    head.walk.nodes.insert_or_assign(head.walk.nodes.end(), record,
                                     IndexWalk::Node{std::move(node.links), needed});
  return true;
}

bool load_index(const ByteSource& source, double t0, double t1, FileHead& head,
                Findings& findings) {
  return Loader(source, head, findings).load(t0, t1);
}

bool load_ahead(const ByteSource& source, double ticks, std::uint64_t entries, FileHead& head,
                Findings& findings) {
  return Loader(source, head, findings).load_ahead(ticks, entries);
}

}  // namespace stgs
