// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "container/container.h"

namespace stgs {

// Checks what the nodes of a completely loaded index state together (spec 5.1 to 5.3, 9.3).
void check_index(const ByteSource& source, const FileHead& head, Findings& findings);

}  // namespace stgs
