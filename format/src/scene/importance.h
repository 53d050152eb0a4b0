// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "container/container.h"

namespace stgs {

// Returns the payload of the record of importances of a finished file whose index is loaded
// completely, if it has one. Reports an error if it is invalid.
std::optional<std::vector<std::uint8_t>> find_importance(const ByteSource& source,
                                                         const FileHead& head, Findings& findings);
// Reads the importances of a file whose index is loaded completely, in the order of its segments
// (spec 11.9); empty if the file has none.
Result<std::vector<float>> read_importance(const ByteSource& source, const FileHead& head);

}  // namespace stgs
