// SPDX-License-Identifier: Apache-2.0
#include "zip_members.h"

#include <algorithm>

#include "container/container.h"
#include "core/bytes.h"
#include "interchange/compression.h"

namespace stgs::web {
namespace {

using View = std::span<const std::uint8_t>;

constexpr std::uint32_t kLocalMark = 0x04034B50, kEntryMark = 0x02014B50, kEndMark = 0x06054B50;
constexpr std::size_t kLocalBytes = 30, kEntryBytes = 46, kEndBytes = 22;
constexpr std::uint64_t kMemberMemory = 128;  // of one member of the list, at most
constexpr int kStored = 0, kDeflated = 8;     // methods

// Returns the end record, which a comment may follow; empty if there is none.
View end_record(View bytes) {
  for (std::size_t size = kEndBytes; size <= std::min(bytes.size(), kEndBytes + 0xFFFF); ++size) {
    const View end = bytes.last(size);
    if (ByteReader(end).u32() == kEndMark) return end;
  }
  return {};
}

}  // namespace

Result<std::unique_ptr<ZipMembers>> ZipMembers::open(View bytes, const std::string& name,
                                                     HostDecoding& decoding, ImportMemory& memory) {
  ByteReader end(end_record(bytes));
  end.bytes(10);  // mark, disks, entries of this disk
  const std::uint32_t count = end.u16(), size = end.u32(), offset = end.u32();
  if (!end.ok()) return invalid_file("{}: not a zip archive, or truncated", name);
  if (count == 0xFFFF || size == 0xFFFFFFFF || offset == 0xFFFFFFFF) {
    return unsupported("{}: zip64 archives are not supported; use 'stgs convert'", name);
  }
  STGS_ASSIGN(Lease lease, memory.take(count * kMemberMemory, "the members of the archive"));
  ByteReader list(bytes.subspan(std::min<std::size_t>(offset, bytes.size())));
  std::map<std::string_view, Member> members;
  for (std::uint32_t i = 0; i < count; ++i) {
    ByteReader entry(list.bytes(kEntryBytes));
    const std::uint32_t mark = entry.u32();
    entry.bytes(4);  // versions
    Member member;
    member.flags = entry.u16();
    member.method = entry.u16();
    entry.bytes(4);  // time
    member.checksum = entry.u32();
    member.stored = entry.u32();
    member.size = entry.u32();
    const std::uint16_t name_bytes = entry.u16(), extra = entry.u16(), comment = entry.u16();
    entry.bytes(8);  // disk, attributes
    member.offset = entry.u32();
    const View text = list.bytes(name_bytes);
    list.bytes(std::uint64_t{extra} + comment);
    if (!list.ok() || mark != kEntryMark) return invalid_file("{}: damaged list of members", name);
    members.emplace(std::string_view(reinterpret_cast<const char*>(text.data()), text.size()),
                    member);
  }
  std::unique_ptr<ZipMembers> files(new ZipMembers(bytes, name, decoding));
  files->members_ = std::move(members);
  files->lease_ = std::move(lease);
  STGS_TRY(files->request_deflated(memory));
  return files;
}

// Invalid members are rejected when they are read.
Status ZipMembers::request_deflated(ImportMemory& memory) {
  for (const auto& [name, member] : members_) {
    if (member.method != kDeflated || !check(member, "").ok()) continue;
    const std::string content = label(std::string(name));
    STGS_TRY(
        decoding_.request(Coding::kDeflate, content, *stored_bytes(member), member.size, memory));
  }
  return {};
}

Status ZipMembers::check(const Member& member, const std::string& label) const {
  const bool is_deflated = member.method == kDeflated;
  if ((member.flags & 1) != 0 || (!is_deflated && member.method != kStored)) {
    return unsupported("{}: encrypted, or compressed with another method than DEFLATE", label);
  }
  if (is_deflated ? member.size / kDeflateRatio > member.stored : member.size != member.stored) {
    return invalid_file("{}: stated size of {} bytes is impossible for {} compressed bytes", label,
                        member.size, member.stored);
  }
  return stored_bytes(member) ? Status() : invalid_file("{}: outside the archive", label);
}

std::optional<View> ZipMembers::stored_bytes(const Member& member) const {
  if (member.offset > bytes_.size()) return std::nullopt;
  ByteReader in(bytes_.subspan(member.offset));
  const std::uint32_t mark = in.u32();
  in.bytes(kLocalBytes - 8);
  const std::uint64_t names = in.u16();
  in.bytes(names + in.u16());
  const View stored = in.bytes(member.stored);
  return mark == kLocalMark && in.ok() ? std::optional(stored) : std::nullopt;
}

Result<View> ZipMembers::content(const std::string& name) const {
  const auto found = members_.find(name);
  if (found == members_.end()) return invalid_file("{}: not found in the archive", label(name));
  const Member& member = found->second;
  STGS_TRY(check(member, label(name)));
  const View content = member.method == kDeflated ? decoding_.content(Coding::kDeflate, label(name))
                                                  : *stored_bytes(member);
  if (checksum(content) != member.checksum) {
    return invalid_file("{}: damaged in the archive: wrong checksum", label(name));
  }
  return content;
}

Result<ChargedBytes> ZipMembers::read(const std::string& name, ImportMemory& memory,
                                      std::uint64_t max_bytes) {
  STGS_ASSIGN(const View bytes, content(name));
  STGS_TRY(check_size(name, bytes.size(), max_bytes));
  ChargedBytes out;
  STGS_ASSIGN(out.lease, memory.take(bytes.size(), "the bytes of " + name));
  out.value.assign(bytes.begin(), bytes.end());
  return out;
}

}  // namespace stgs::web
