// SPDX-License-Identifier: Apache-2.0
// Files that grow: the index in fragments (spec 5.12).
#include <algorithm>
#include <limits>

#include "bytes.h"
#include "container.h"

namespace stgs {
namespace {

using N = IssueNumber;

// Beside the index: frames, flags, bounds, previous; at the end the length again.
constexpr std::uint64_t kFixedBytes = 4 + 4 + 6 * 4 + 8, kLengthBytes = 8;

struct Fragment {
  std::uint64_t offset = 0;  // of its record
  std::uint64_t end = 0;
  FragmentHeader header;
  std::vector<std::uint8_t> payload;
};

// Whether a record lies at `offset` whole; the header is that of a record either way where `sound`.
struct Probe {
  RecordHeader header;
  bool sound = false, whole = false;
};
Result<Probe> probe_record(const ByteSource& source, std::uint64_t offset) {
  Probe probe;
  const std::uint64_t size = source.size();
  if (offset > size || size - offset < kRecordHeaderBytes) return probe;
  std::vector<std::uint8_t> bytes(kRecordHeaderBytes);
  STGS_TRY(source.read(offset, bytes));
  Findings ignored;  // what is found depends on whether the end of the file is complete
  probe.sound = parse_record_header(bytes, offset, std::numeric_limits<std::uint64_t>::max(),
                                    probe.header, ignored);
  probe.whole = probe.sound && probe.header.length <= size - offset - kRecordHeaderBytes;
  return probe;
}

bool is_fragment(const Probe& probe) {
  return probe.whole && probe.header.tag == kFragmentTag && probe.header.flags == kCritical &&
         probe.header.length >= kFixedBytes + kLengthBytes;
}

// The fragment at `offset`, or nothing where there is none that is sound.
Result<std::optional<Fragment>> read_fragment(const ByteSource& source, std::uint64_t offset,
                                              const ReadLimits& limits) {
  STGS_ASSIGN(const Probe probe, probe_record(source, offset));
  if (!is_fragment(probe)) return std::optional<Fragment>();
  if (probe.header.length > limits.max_memory) {
    return unsupported("a fragment of the index has {} bytes, more than the limit of {}",
                       probe.header.length, limits.max_memory);
  }
  Fragment fragment;
  fragment.offset = offset;
  fragment.end = offset + kRecordHeaderBytes + probe.header.length;
  fragment.payload.resize(probe.header.length);
  STGS_TRY(source.read(offset + kRecordHeaderBytes, fragment.payload));
  if (checksum(fragment.payload) != probe.header.checksum) return std::optional<Fragment>();
  ByteReader in(fragment.payload);
  FragmentHeader& header = fragment.header;
  header.frames = in.u32();
  header.flags = in.u32();
  for (float& v : header.bounds_min) v = in.f32();
  for (float& v : header.bounds_max) v = in.f32();
  header.previous = in.u64();
  return std::optional<Fragment>(std::move(fragment));
}

// A complete file ends with its last fragment, whose length stands in its last bytes.
Result<std::optional<Fragment>> fragment_at_end(const ByteSource& source, std::uint64_t body_at,
                                                const ReadLimits& limits) {
  const std::uint64_t size = source.size(), least = kRecordHeaderBytes + kLengthBytes;
  if (size < least || size - least < body_at) return std::optional<Fragment>();
  std::vector<std::uint8_t> bytes(kLengthBytes);
  STGS_TRY(source.read(size - kLengthBytes, bytes));
  const std::uint64_t length = ByteReader(bytes).u64();
  if (length > size - body_at - kRecordHeaderBytes) return std::optional<Fragment>();
  return read_fragment(source, size - kRecordHeaderBytes - length, limits);
}

// The last sound one of those that can be reached record by record.
Result<std::optional<Fragment>> fragment_by_walk(const ByteSource& source, std::uint64_t from,
                                                 const ReadLimits& limits) {
  std::vector<std::uint64_t> offsets;
  for (std::uint64_t at = from;;) {
    STGS_ASSIGN(const Probe probe, probe_record(source, at));
    if (!probe.whole) break;
    if (is_fragment(probe)) offsets.push_back(at);
    at += kRecordHeaderBytes + probe.header.length;
  }
  for (; !offsets.empty(); offsets.pop_back()) {
    STGS_ASSIGN(std::optional<Fragment> found, read_fragment(source, offsets.back(), limits));
    if (found) return found;
  }
  return std::optional<Fragment>();
}

// The fragments that list all parts up to `last`, the earliest first.
bool chain_of(const ByteSource& source, Fragment last, std::uint64_t body_at,
              const ReadLimits& limits, std::vector<Fragment>& chain, Findings& findings) {
  std::uint64_t bytes = 0;
  chain.push_back(std::move(last));
  while (chain.back().header.previous != 0) {
    bytes += chain.back().payload.size();
    const std::uint64_t previous = chain.back().header.previous;
    if (previous < body_at || previous >= chain.back().offset) {
      findings.error(N::kFragment, chain.back().offset,
                     "a fragment of the index follows one at byte {}, which cannot be", previous);
      return false;
    }
    if (bytes > limits.max_memory) {
      findings.unsupported(N::kMemoryLimit, previous,
                           "the index has more bytes than the limit of {}", limits.max_memory);
      return false;
    }
    Result<std::optional<Fragment>> fragment = read_fragment(source, previous, limits);
    if (!fragment.ok()) {
      findings.failed_read(previous, fragment.status());
      return false;
    }
    if (!*fragment) {
      findings.error(N::kFragment, previous, "a fragment of the index is damaged or is none");
      return false;
    }
    chain.push_back(std::move(**fragment));
  }
  std::reverse(chain.begin(), chain.end());
  return true;
}

bool check_header(const Fragment& fragment, FileHead& head, Findings& findings) {
  const FragmentHeader& header = fragment.header;
  if ((header.flags & ~kFragmentClosed) != 0) {
    findings.unsupported(N::kUnknownCritical, fragment.offset,
                         "a fragment of flags {:#x}, unknown to this version", header.flags);
    return false;
  }
  SceneMetadata& scene = head.metadata.scene;
  scene.frames = header.frames;
  std::copy_n(header.bounds_min, 3, scene.bounds_min);
  std::copy_n(header.bounds_max, 3, scene.bounds_max);
  if (header.frames == 0) {
    findings.error(N::kTimeBase, fragment.offset, "a fragment of a file of no frames");
    return false;
  }
  check_metadata_values(head.metadata, fragment.offset, findings);
  return true;
}

}  // namespace

std::vector<std::uint8_t> write_fragment(const FragmentHeader& header,
                                         std::span<const std::uint8_t> index) {  // spec 5.12
  ByteWriter out;
  out.u32(header.frames);
  out.u32(header.flags);
  for (float v : header.bounds_min) out.f32(v);
  for (float v : header.bounds_max) out.f32(v);
  out.u64(header.previous);
  out.bytes(index);
  out.u64(out.size() + kLengthBytes);
  return write_record(kFragmentTag, out.view());
}

bool read_fragments(const ByteSource& source, const ReadLimits& limits, FileHead& head,
                    Findings& findings) {
  const std::uint64_t body_at = head.header.head_bytes;
  Result<std::optional<Fragment>> last = fragment_at_end(source, body_at, limits);
  if (last.ok() && !*last) last = fragment_by_walk(source, body_at, limits);
  if (!last.ok()) {
    findings.failed_read(body_at, last.status());
    return false;
  }
  if (!*last) {  // nothing is complete yet
    head.index_bytes = body_at;
    head.header.file_bytes = body_at;
    head.parts.push_back({0.0, static_cast<double>(head.metadata.scene.frames), 0});
    head.index.chunk_ticks = 1.0;
    return true;
  }
  head.header.file_bytes = (*last)->end;
  head.closed = ((*last)->header.flags & kFragmentClosed) != 0;
  if (!check_header(**last, head, findings)) return false;
  if (head.closed && source.size() > head.header.file_bytes) {
    findings.error(N::kFileSize, head.header.file_bytes,
                   "the file has bytes after its end: {} bytes instead of {}; copy or fetch it "
                   "again",
                   source.size(), head.header.file_bytes);
  }
  std::vector<Fragment> chain;
  if (!chain_of(source, std::move(**last), body_at, limits, chain, findings)) return false;
  head.index_bytes = body_at;
  for (const Fragment& fragment : chain) {
    head.index_bytes += fragment.end - fragment.offset;
    const std::span<const std::uint8_t> payload(fragment.payload);
    const std::uint64_t base = fragment.header.previous;
    const RecordArea area = {base != 0 ? base : body_at, fragment.offset};
    if (!parse_index(payload.subspan(kFixedBytes, payload.size() - kFixedBytes - kLengthBytes),
                     fragment.offset + kRecordHeaderBytes + kFixedBytes, area, head, findings)) {
      return false;
    }
  }
  check_index(head, chain.back().offset, limits, findings);
  return true;
}

}  // namespace stgs
