// SPDX-License-Identifier: Apache-2.0
// Nodes of an index: reading, writing, and following the links between them (spec 5.2, 5.3, 9).
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <vector>

#include "container/container.h"
#include "core/bytes.h"

namespace stgs {

// Memory charged for each entry of an index, and the number of entries free of charge (conformance
// 1.5).
inline constexpr std::uint64_t kEntryMemory = 512, kFreeEntries = 1024;
// An index may list kFreeRecords records, and one more for each kBytesPerRecord bytes of the file.
inline constexpr std::uint64_t kFreeRecords = 4096, kBytesPerRecord = 20;

// Reserves room for `more` entries. A list grows by half, or exactly if that is more.
template <typename Entry>
void make_room(std::size_t more, std::vector<Entry>& entries) {
  const std::size_t size = entries.size() + more;
  if (size > entries.capacity()) entries.reserve(std::max(size, entries.size() * 3 / 2));
}

// Segments and further records of a run must be in file order.
void write_node(const IndexNode& node, ByteWriter& out);
void write_links(std::span<const NodeLink> links, ByteWriter& out);
// Returns the payload of INDX.
std::vector<std::uint8_t> write_index(const FileIndex& index, const IndexNode& root);

// The record that a node is read from.
struct NodePlace {
  std::uint64_t record = 0;          // offset of the record
  std::uint64_t payload = 0;         // offset of the first byte that is read, for messages
  std::uint64_t begin = 0, end = 0;  // the range of the file that contains the listed records
  std::uint64_t uncounted = 0;       // bytes of the node that FileHead::index_bytes lacks so far
};
// Reads a node of a file whose header and metadata have been read. `in` is left after it.
bool parse_node(ByteReader& in, const NodePlace& place, const FileHead& head, IndexNode& node,
                Findings& findings);
bool parse_links(ByteReader& in, const NodePlace& place, const FileHead& head,
                 std::vector<NodeLink>& links, Findings& findings);
// Adds the segments of a node that `depth` links lead to, and its links as pending ones before
// `next`. `record`: offset of its record; 0 for INDX. Returns false if the caller's limits are
// exceeded.
bool add_node(IndexNode node, std::uint64_t record, int depth,
              IndexWalk::Links::const_iterator next, FileHead& head, Findings& findings);
// Counts the bytes of a node at `at` (conformance 1.5). Returns false if the caller's limits are
// exceeded.
bool take_node(std::uint64_t at, std::uint64_t payload, FileHead& head, Findings& findings);
// Reads the payload of INDX.
bool parse_index(std::span<const std::uint8_t> payload, std::uint64_t offset, FileHead& head,
                 Findings& findings);

// A FRAG record (spec 9.2).
struct FragmentRecord {
  std::uint64_t offset = 0, end = 0;  // of the record
  std::uint32_t checksum = 0;         // of the payload, as read
  std::uint32_t frames = 0, flags = 0;
  float bounds_min[3] = {0, 0, 0}, bounds_max[3] = {0, 0, 0};
  std::uint64_t primitives = 0;
  std::vector<std::uint8_t> head;  // copy of the head
  std::vector<NodeLink> earlier;   // links besides those of its node
  IndexNode node;
};
inline constexpr std::uint32_t kFragmentClosed = 1;  // fragment flag, spec 9.2
inline constexpr std::uint32_t kCriticalFragmentFlags = 0xFFFF;

// Adds the earlier links of a fragment (spec 9.3, 9.5), once, as pending ones before `next`.
// `depth`: number of links that lead to them. Returns false if the caller's limits are exceeded.
bool add_earlier(const FragmentRecord& fragment, int depth, IndexWalk::Links::const_iterator next,
                 FileHead& head, Findings& findings);
// Returns a FRAG record.
std::vector<std::uint8_t> write_fragment(const FragmentRecord& fragment);

// Finds valid FRAG records of a file (spec 9.4). All functions return kUnsupported if a record
// exceeds the memory limit.
class FragmentFinder {
 public:
  using Found = std::optional<FragmentRecord>;
  // `head`: the head of the file; it has no bytes if they are damaged. `search`: of this source.
  // Neither is copied.
  FragmentFinder(const ByteSource& source, const FileHead& head, FragmentSearch& search);
  // Returns the one that begins last. Sets FragmentSearch::damaged.
  Result<Found> last();
  // Returns the one at `offset`, of a payload of `bytes` if that is stated; if there is none, `why`
  // has the reason.
  Result<Found> at(std::uint64_t offset, std::optional<std::uint64_t> bytes, Findings& why);
  // Returns the one that begins last of those that begin before `end`. All searches together
  // examine at most as many bytes in vain as the source has, and then end without a result
  // (conformance 1.5).
  Result<FragmentSearch::Found> last_before(std::uint64_t end);

 private:
  Result<Found> read(std::uint64_t offset, const RecordHeader& record, Findings& why);
  Result<Found> check(std::uint64_t offset, const RecordHeader& record,
                      std::span<const std::uint8_t> bytes, Findings& why);
  bool parse(std::span<const std::uint8_t> payload, FragmentRecord& fragment,
             Findings& findings) const;
  Status check_own_offset(std::uint64_t offset);
  Result<FragmentSearch::Found> search(std::uint64_t low, std::uint64_t high);
  Result<FragmentSearch::Found> examine(std::uint64_t offset, const RecordHeader& record,
                                        std::span<const std::uint8_t> after);

  const ByteSource& source_;
  const FileHead& head_;
  FragmentSearch& search_;
  std::uint64_t body_at_ = 0;
  Found recent_;             // the last one that a search found, until it is returned
  bool is_foreign_ = false;  // the last record that was read is intact and states another offset
};

}  // namespace stgs
