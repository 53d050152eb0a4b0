// SPDX-License-Identifier: Apache-2.0
#include "zip_members.h"

#include <algorithm>
#include <map>
#include <optional>
#include <string_view>

#include "container/container.h"
#include "core/bytes.h"
#include "unpack/inflate.h"

namespace stgs::web {
namespace {

using View = std::span<const std::uint8_t>;

constexpr std::uint32_t kLocalMark = 0x04034B50, kEntryMark = 0x02014B50, kEndMark = 0x06054B50;
constexpr std::size_t kLocalBytes = 30, kEntryBytes = 46, kEndBytes = 22;
constexpr std::uint64_t kMemberMemory = 128;  // of one member of the list, at most
constexpr std::uint64_t kMaxRatio = 1032;     // of DEFLATE

struct Member {
  int flags = 0, method = 0;
  std::uint32_t checksum = 0, stored = 0, size = 0, offset = 0;
};
using Members = std::map<std::string_view, Member>;  // names are those of the archive's bytes

class ZipMembers final : public NamedFiles {
 public:
  ZipMembers(View bytes, std::string name, Members members, Lease lease)
      : bytes_(bytes),
        name_(std::move(name)),
        members_(std::move(members)),
        lease_(std::move(lease)) {}

  std::string label(const std::string& name) const override { return name_ + ":" + name; }

  Result<ChargedBytes> read(const std::string& name, ImportMemory& memory,
                            std::uint64_t max_bytes) override {
    const auto found = members_.find(name);
    if (found == members_.end()) {
      return invalid_file("{}: not found in the archive", label(name));
    }
    const Member& member = found->second;
    if (member.size > max_bytes) {
      return unsupported("{}: too large (at most {} bytes allowed, got {})", label(name), max_bytes,
                         member.size);
    }
    const bool is_deflated = member.method == 8;
    if ((member.flags & 1) != 0 || (!is_deflated && member.method != 0)) {
      return unsupported("{}: encrypted, or compressed with another method than DEFLATE",
                         label(name));
    }
    if (is_deflated ? member.size / kMaxRatio > member.stored : member.size != member.stored) {
      return invalid_file("{}: stated size of {} bytes is impossible for {} compressed bytes",
                          label(name), member.size, member.stored);
    }
    const std::optional<View> content = content_of(member);
    if (!content) return invalid_file("{}: outside the archive", label(name));
    ChargedBytes out;
    STGS_ASSIGN(out.lease, memory.take(member.size, "the bytes of " + name));
    out.value.resize(member.size);
    if (is_deflated ? !inflate_all(*content, out.value) : !copy_all(*content, out.value)) {
      return invalid_file("{}: damaged in the archive", label(name));
    }
    if (checksum(out.value, 0) != member.checksum) {
      return invalid_file("{}: damaged in the archive: wrong checksum", label(name));
    }
    return out;
  }

 private:
  static bool copy_all(View content, std::span<std::uint8_t> out) {
    std::copy(content.begin(), content.end(), out.begin());
    return true;
  }
  static bool inflate_all(View content, std::span<std::uint8_t> out) {
    Inflate inflate(content);
    std::uint8_t past_the_end = 0;
    return inflate.read(out) == out.size() && inflate.read({&past_the_end, 1}) == std::size_t{0};
  }

  std::optional<View> content_of(const Member& member) const {
    if (member.offset > bytes_.size()) return std::nullopt;
    ByteReader in(bytes_.subspan(member.offset));
    const std::uint32_t mark = in.u32();
    in.bytes(kLocalBytes - 8);
    const std::uint64_t names = in.u16();
    in.bytes(names + in.u16());
    const View content = in.bytes(member.stored);
    return mark == kLocalMark && in.ok() ? std::optional(content) : std::nullopt;
  }

  View bytes_;
  std::string name_;
  Members members_;
  Lease lease_;
};

// Returns the end record, which a comment may follow; empty if there is none.
View end_record(View bytes) {
  for (std::size_t size = kEndBytes; size <= std::min(bytes.size(), kEndBytes + 0xFFFF); ++size) {
    const View end = bytes.last(size);
    if (ByteReader(end).u32() == kEndMark) return end;
  }
  return {};
}

}  // namespace

Result<std::unique_ptr<NamedFiles>> zip_members(View bytes, const std::string& name,
                                                ImportMemory& memory) {
  ByteReader end(end_record(bytes));
  end.bytes(10);  // mark, disks, entries of this disk
  const std::uint32_t count = end.u16(), size = end.u32(), offset = end.u32();
  if (!end.ok()) return invalid_file("{}: not a zip archive, or truncated", name);
  if (count == 0xFFFF || size == 0xFFFFFFFF || offset == 0xFFFFFFFF) {
    return unsupported("{}: a zip archive of 64 bits; use 'stgs convert'", name);
  }
  STGS_ASSIGN(Lease lease, memory.take(count * kMemberMemory, "the members of the archive"));
  ByteReader list(bytes.subspan(std::min<std::size_t>(offset, bytes.size())));
  Members members;
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
  return std::unique_ptr<NamedFiles>(
      std::make_unique<ZipMembers>(bytes, name, std::move(members), std::move(lease)));
}

}  // namespace stgs::web
