// SPDX-License-Identifier: Apache-2.0
// The members of a zip archive in memory, for the import module, which has no libzip.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "interchange/named_files.h"

namespace stgs::web {

// Opens an archive, whose bytes must outlive the object. Members may be stored or deflated; their
// checksums are verified. Encrypted archives and those of 64 bits are rejected. The list of members
// is charged to `memory`, which must outlive the object. `name`: the archive, for messages.
Result<std::unique_ptr<NamedFiles>> zip_members(std::span<const std::uint8_t> bytes,
                                                const std::string& name, ImportMemory& memory);

}  // namespace stgs::web
