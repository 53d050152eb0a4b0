// SPDX-License-Identifier: Apache-2.0
// The files of a set by name: a folder's, or the members of a zip archive.
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
  // The whole file. Refuses names that lead out of the set, and files of more than `max_bytes`
  // before it allocates. Called by one thread at a time.
  virtual Result<std::vector<std::uint8_t>> read(const std::string& name,
                                                 std::uint64_t max_bytes) = 0;
  // What messages call a file of the set.
  virtual std::string label(const std::string& name) const = 0;
};

std::unique_ptr<NamedFiles> folder_files(const std::string& folder);
// Opens the archive; members may be stored or deflated, and their checksums are verified.
Result<std::unique_ptr<NamedFiles>> zip_files(const std::string& path);

}  // namespace stgs
