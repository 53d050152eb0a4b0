// SPDX-License-Identifier: Apache-2.0
// Private numbers and the names of their owners (spec 3.5).
#include <algorithm>
#include <cctype>

#include "container/container.h"
#include "core/bytes.h"
#include "stgs/format/text.h"

namespace stgs {
namespace {

using N = IssueNumber;

constexpr std::uint16_t kFirstPrivateNumber = 0xC000;  // of attributes and profiles

bool is_name(const std::string& text) {
  return !text.empty() && is_utf8(text);
}

// Returns whether the first letter of a tag is lower case.
bool is_private(std::uint32_t tag) {
  return std::islower(static_cast<unsigned char>(tag & 0xFF)) != 0;
}

void need_name(PrivateKind kind, std::uint16_t number, std::uint64_t offset, const FileHead& head,
               Findings& findings) {
  const auto names_it = [=](const PrivateName& name) {
    return name.kind == kind && name.number == number;
  };
  const std::vector<PrivateName>& names = head.private_names;
  if (std::any_of(names.begin(), names.end(), names_it)) return;
  constexpr const char* kKinds[] = {"attribute", "profile", "content"};
  findings.error(N::kPrivate, offset, "private {} {:#x} is not named in PRIV",
                 kKinds[static_cast<int>(kind)], number);
}

}  // namespace

bool parse_private_names(std::span<const std::uint8_t> payload, std::uint64_t offset,
                         FileHead& head, Findings& findings) {
  ByteReader in(payload);
  const std::size_t count = in.u16();
  bool good = in.ok();
  for (std::size_t i = 0; i < count && good; ++i) {
    PrivateName name;
    const std::uint16_t kind = in.u16();
    name.number = in.u16();
    name.name = in.string();
    good = in.ok() && is_name(name.name);
    if (!good || kind > static_cast<int>(PrivateKind::kContent)) continue;  // of a later version
    name.kind = static_cast<PrivateKind>(kind);
    head.private_names.push_back(std::move(name));
  }
  if (good) return true;
  head.private_names.clear();
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
  for (const Layout& layout : set.layouts) {
    for (const StreamRow& row : layout.streams) {
      if (row.attribute < kFirstPrivateNumber) continue;
      need_name(PrivateKind::kAttribute, row.attribute, offset, head, findings);
    }
  }
}

void check_private_numbers(const FileHead& head, Findings& findings) {
  if (head.metadata.profile_number >= kFirstPrivateNumber) {
    need_name(PrivateKind::kProfile, head.metadata.profile_number, kHeaderBytes, head, findings);
  }
  check_private_layouts(head.layouts, kHeaderBytes, head, findings);
  for (const FurtherEntry& further : head.index.further) {
    const auto content = static_cast<std::uint16_t>(content_of(further.entry.layer));
    if (content < kFirstPrivateContent) continue;
    need_name(PrivateKind::kContent, content, further.entry.offset, head, findings);
  }
}

}  // namespace stgs
