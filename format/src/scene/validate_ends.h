// SPDX-License-Identifier: Apache-2.0
// Checks of the ends of a file (spec 5.9), for the validator.
#pragma once

#include "container/container.h"

namespace stgs {

// Checks that the loaded ends name primitives of the file, and that their parts do not end before
// the scene. Damaged records are reported when they are loaded.
void check_ends(const FileHead& head, Findings& findings);

}  // namespace stgs
