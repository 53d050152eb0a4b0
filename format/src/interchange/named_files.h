// SPDX-License-Identifier: Apache-2.0
// Files of a set by name: those of a folder, or the members of a zip archive.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "stgs/format/status.h"

namespace stgs {

class NamedFiles {
 public:
  virtual ~NamedFiles() = default;
  // Reads a complete file. Rejects names that lead out of the set and, before allocating, files of
  // more than `max_bytes`. One thread at a time.
  virtual Result<std::vector<std::uint8_t>> read(const std::string& name,
                                                 std::uint64_t max_bytes) = 0;
  // Returns the name of a file for messages.
  virtual std::string label(const std::string& name) const = 0;
};

std::unique_ptr<NamedFiles> folder_files(const std::string& folder);
// Opens a zip archive. Members may be stored or deflated; their checksums are verified.
Result<std::unique_ptr<NamedFiles>> zip_files(const std::string& path);

}  // namespace stgs
