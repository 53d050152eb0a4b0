// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "container/container.h"

namespace stgs {

// Reads the importances of a file whose index is loaded completely, in the order of its segments
// (spec 11.9); empty if the file has none.
Result<std::vector<float>> read_importance(const ByteSource& source, const FileHead& head);

}  // namespace stgs
