// SPDX-License-Identifier: Apache-2.0
// Private numbers and the names of their owners (spec 3.5).
#include <algorithm>
#include <cctype>
#include <map>
#include <set>

#include "container/container.h"
#include "core/bytes.h"
#include "stgs/format/text.h"

namespace stgs {
namespace {

using N = IssueNumber;

constexpr std::uint16_t kFirstPrivateNumber = 0xC000;  // of attributes and profiles
constexpr std::size_t kPrivateKinds = 3;
constexpr std::size_t kMinNameBytes = 9;  // bytes of an entry: kind, number, length, a letter

bool is_name(const std::string& text) {
  return !text.empty() && is_utf8(text);
}

// Returns whether the first letter of a tag is lower case.
bool is_private(std::uint32_t tag) {
  return std::islower(static_cast<unsigned char>(tag & 0xFF)) != 0;
}

std::size_t private_key(PrivateKind kind, std::uint16_t number) {
  return static_cast<std::size_t>(kind) << 16 | number;
}

// Reports each number that has no name once.
void need_names(PrivateKind kind, const std::set<std::uint16_t>& numbers, std::uint64_t offset,
                const FileHead& head, Findings& findings) {
  constexpr const char* kKinds[] = {"attribute", "profile", "content"};
  for (const std::uint16_t number : numbers) {
    if (!head.named_numbers.empty() && head.named_numbers[private_key(kind, number)]) continue;
    findings.error(N::kPrivate, offset, "private {} {:#x} is not named in PRIV",
                   kKinds[static_cast<int>(kind)], number);
  }
}

}  // namespace

bool parse_private_names(std::span<const std::uint8_t> payload, std::uint64_t offset,
                         FileHead& head, Findings& findings) {
  ByteReader in(payload);
  const std::size_t count = in.u16();
  bool good = in.ok();
  head.private_names.reserve(std::min(count, payload.size() / kMinNameBytes));
  head.named_numbers.resize(std::size_t{kPrivateKinds} << 16);
  for (std::size_t i = 0; i < count && good; ++i) {
    PrivateName name;
    const std::uint16_t kind = in.u16();
    name.number = in.u16();
    name.name = in.string();
    good = in.ok() && is_name(name.name);
    if (!good || kind > static_cast<int>(PrivateKind::kContent)) continue;  // of a later version
    name.kind = static_cast<PrivateKind>(kind);
    head.named_numbers[private_key(name.kind, name.number)] = true;
    head.private_names.push_back(std::move(name));
  }
  if (good) return true;
  head.private_names.clear();
  head.named_numbers.clear();
  findings.error(N::kPrivate, offset,
                 "private names: {} entries do not fit in {} bytes, or a name is invalid", count,
                 payload.size());
  return false;
}

void check_private_record(const RecordHeader& record, std::span<const std::uint8_t> payload,
                          std::uint64_t offset, Findings& findings) {
  if (!is_private(record.tag)) return;
  ByteReader in(payload);
  const std::string name = in.string();
  if (in.ok() && is_name(name)) return;
  findings.error(N::kPrivate, offset, "private record '{}' does not begin with its owner's name",
                 tag_text(record.tag));
}

void check_private_layouts(const LayoutSet& set, std::uint64_t offset, const FileHead& head,
                           Findings& findings) {
  std::set<std::uint16_t> numbers;
  for (const Layout& layout : set.layouts) {
    for (const StreamRow& row : layout.streams) {
      if (row.attribute >= kFirstPrivateNumber) numbers.insert(row.attribute);
    }
  }
  need_names(PrivateKind::kAttribute, numbers, offset, head, findings);
}

void check_private_numbers(const FileHead& head, Findings& findings) {
  if (head.metadata.profile_number >= kFirstPrivateNumber) {
    need_names(PrivateKind::kProfile, {head.metadata.profile_number}, kHeaderBytes, head, findings);
  }
  check_private_layouts(*head.layouts, kHeaderBytes, head, findings);
  std::map<std::uint16_t, std::uint64_t> contents;  // and the first record of each
  for (const FurtherEntry& further : head.index.further) {
    const auto content = static_cast<std::uint16_t>(content_of(further.entry.layer));
    if (content >= kFirstPrivateContent) contents.emplace(content, further.entry.offset);
  }
  for (const auto& [content, offset] : contents) {
    need_names(PrivateKind::kContent, {content}, offset, head, findings);
  }
}

}  // namespace stgs
