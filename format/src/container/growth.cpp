// SPDX-License-Identifier: Apache-2.0
// Reading the fragments appended to a growing file (spec 9.4).
#include <algorithm>
#include <utility>

#include "container/node.h"

namespace stgs {
namespace {

using N = IssueNumber;

bool check_fragment_flags(const FragmentRecord& fragment, Findings& findings) {
  const std::uint32_t unknown = fragment.flags & kCriticalFragmentFlags & ~kFragmentClosed;
  if (unknown == 0) return true;
  findings.unsupported(N::kUnknownCritical, fragment.offset,
                       "fragment has unknown critical flags {:#x}", unknown);
  return false;
}

// Loads the records of ends to which pending links before `end` lead. They concern times that are
// known already, so that readers do not wait for them later.
bool load_new_ends(const ByteSource& source, IndexWalk::Links::const_iterator end, FileHead& head,
                   Findings& findings) {
  IndexWalk::Links& pending = head.walk.pending;
  for (IndexWalk::Links::const_iterator at = pending.begin(); at != end;) {
    if (!at->ends) {
      ++at;
      continue;
    }
    const FurtherEntry ends = *at->ends;
    at = pending.erase(at);
    if (!load_ends(source, ends, head, findings)) return false;
  }
  return true;
}

// Takes frames, bounds and counts from the last FRAG record, and adds its node.
bool add_last(const ByteSource& source, FragmentRecord& fragment, FileHead& head,
              Findings& findings) {
  if (!check_fragment_flags(fragment, findings)) return false;
  head.header.file_bytes = fragment.end;
  head.closed = (fragment.flags & kFragmentClosed) != 0;
  SceneMetadata& scene = head.metadata.scene;
  scene.frames = fragment.frames;
  std::copy_n(fragment.bounds_min, 3, scene.bounds_min);
  std::copy_n(fragment.bounds_max, 3, scene.bounds_max);
  head.index.primitives = fragment.primitives;
  if (fragment.primitives > head.limits.max_primitives) {
    findings.unsupported(N::kPrimitiveLimit, fragment.offset,
                         "index: {} primitives exceed the limit of {}", fragment.primitives,
                         head.limits.max_primitives);
    return false;
  }
  const std::uint64_t bytes = fragment.end - fragment.offset;
  head.walk.followed.insert(fragment.offset);
  const IndexWalk::Links::const_iterator next = head.walk.pending.begin();
  const TickRange needed = needed_of(fragment.node);
  if (!take_node(fragment.offset, bytes - kRecordHeaderBytes, head, findings) ||
      !add_node(std::move(fragment.node), fragment.offset, 0, next, head, findings) ||
      !load_new_ends(source, next, head, findings) ||
      !add_earlier(fragment, 1, next, head, findings)) {
    return false;
  }
  head.last_fragment = LastFragment{
      fragment.offset, bytes, fragment.checksum, fragment.frames, std::move(fragment.earlier),
      needed};
  return true;
}

// Reports a damaged FRAG record after the last valid one, once (spec 9.4).
void report_damaged(const std::optional<FragmentRecord>& last, FileHead& head, Findings& findings) {
  const std::uint64_t at = head.walk.search.damaged;
  if (at == 0 || at == head.walk.damaged) return;
  head.walk.damaged = at;
  findings.damage(N::kFragment, at,
                  "a fragment is damaged; content that was added from it on is lost");
  const double begin = last ? last->frames : 0.0;
  const std::uint64_t from = last ? last->end : head.header.head_bytes;
  head.lost_fragments.push_back(
      {{begin, std::max(begin, static_cast<double>(head.metadata.scene.frames))},
       from,
       head.available_bytes - from});
}

// Returns whether the known last fragment is still there.
bool is_continued(const ByteSource& source, const FileHead& head, Findings& findings) {
  if (!head.last_fragment) return true;
  const LastFragment& known = *head.last_fragment;
  const auto record = complete_record_at(source, known.offset, source.size());
  if (!record.ok()) {
    findings.failed_read(known.offset, record.status());
    return false;
  }
  const bool same = *record && (*record)->tag == kFragmentTag &&
                    (*record)->checksum == known.checksum &&
                    (*record)->length == known.bytes - kRecordHeaderBytes;
  if (!same) findings.error(N::kFragment, known.offset, "another recording has taken its place");
  return same;
}

}  // namespace

bool read_growth(const ByteSource& source, FileHead& head, bool& grown, Findings& findings) {
  grown = false;
  const std::uint64_t before = std::exchange(head.available_bytes, source.size());
  head.walk.search.resume(before, head.available_bytes);
  Result<std::optional<FragmentRecord>> last =
      FragmentFinder(source, head, head.walk.search).last();
  if (!last.ok()) {
    findings.failed_search(head.header.head_bytes, last.status());
    return false;
  }
  report_damaged(*last, head, findings);
  grown = *last && (!head.last_fragment || (*last)->offset > head.last_fragment->offset);
  if (grown) head.walk.search.searched = 0;
  if (grown && (!is_continued(source, head, findings) || !add_last(source, **last, head, findings)))
    return false;
  if (!head.last_fragment) head.header.file_bytes = head.header.head_bytes;  // nothing is complete
  if (head.closed && source.size() > head.header.file_bytes) {
    findings.damage(N::kFileSize, head.header.file_bytes,
                    "extra bytes after the end of the file (expected {} bytes, got {}); copy or "
                    "download it again",
                    head.header.file_bytes, source.size());
  }
  if (grown) check_window(head.metadata.scene, findings);
  return true;
}

}  // namespace stgs
