// SPDX-License-Identifier: Apache-2.0
// Files of a set by name: those of a folder, or the members of a zip archive.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "interchange/import_memory.h"

namespace stgs {

class NamedFiles {
 public:
  virtual ~NamedFiles() = default;
  // Reads a complete file and charges its bytes. Rejects names that lead out of the set and, before
  // allocating, files of more than `max_bytes`. One thread at a time.
  virtual Result<ChargedBytes> read(const std::string& name, ImportMemory& memory,
                                    std::uint64_t max_bytes = ~std::uint64_t{0}) = 0;
  // Returns the name of a file for messages.
  virtual std::string label(const std::string& name) const = 0;

 protected:
  // Rejects a file that is too large for a caller.
  Status check_size(const std::string& name, std::uint64_t bytes, std::uint64_t max_bytes) const {
    if (bytes <= max_bytes) return {};
    return unsupported("{}: too large (at most {} bytes allowed, got {})", label(name), max_bytes,
                       bytes);
  }
};

std::unique_ptr<NamedFiles> folder_files(const std::string& folder);
// Opens a zip archive. Members may be stored or deflated; their checksums are verified. The list of
// members is charged to `memory`, which must outlive the object. read() fails (kUnsupported) once
// all calls together have read 256 MiB and 64 times the bytes of the archive.
Result<std::unique_ptr<NamedFiles>> zip_files(const std::string& path, ImportMemory& memory);

}  // namespace stgs
