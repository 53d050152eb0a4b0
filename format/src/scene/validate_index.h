// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <set>

#include "container/container.h"

namespace stgs {

// Checks for the validator what the nodes and parts of a completely loaded index state together
// (spec 5.1 to 5.3, 9.3). Returns the offsets of the copies of nodes.
std::set<std::uint64_t> check_index(const ByteSource& source, const FileHead& head,
                                    Findings& findings);

}  // namespace stgs
