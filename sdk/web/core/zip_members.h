// SPDX-License-Identifier: Apache-2.0
// The members of a zip archive in memory, for the import module: browsers cannot read zip.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "host_decoding.h"
#include "interchange/named_files.h"

namespace stgs::web {

class ZipMembers final : public NamedFiles {
 public:
  // Opens an archive, and requests the content of its deflated members. Encrypted members and zip64
  // archives are rejected. The list of members is charged to `memory`. `name`: the
  // archive, for messages. `bytes`, `decoding` and `memory` must outlive the object.
  static Result<std::unique_ptr<ZipMembers>> open(std::span<const std::uint8_t> bytes,
                                                  const std::string& name, HostDecoding& decoding,
                                                  ImportMemory& memory);

  // Returns the content of a member, valid as long as this object. Call it after the host has
  // decoded the content that open() requested. Verifies the checksum.
  Result<std::span<const std::uint8_t>> content(const std::string& name) const;

  std::string label(const std::string& name) const override { return name_ + ":" + name; }
  Result<ChargedBytes> read(const std::string& name, ImportMemory& memory,
                            std::uint64_t max_bytes) override;

 private:
  struct Member {
    int flags = 0, method = 0;
    std::uint32_t checksum = 0, stored = 0, size = 0, offset = 0;
  };

  ZipMembers(std::span<const std::uint8_t> bytes, std::string name, HostDecoding& decoding)
      : bytes_(bytes), name_(std::move(name)), decoding_(decoding) {}
  Status request_deflated(ImportMemory& memory);
  Status check(const Member& member, const std::string& label) const;
  std::optional<std::span<const std::uint8_t>> stored_bytes(const Member& member) const;

  std::span<const std::uint8_t> bytes_;
  std::string name_;
  HostDecoding& decoding_;
  std::map<std::string_view, Member> members_;  // names are in bytes_
  Lease lease_;                                 // of the list
};

}  // namespace stgs::web
