// SPDX-License-Identifier: Apache-2.0
// The integers of a record's streams, besides those of the quantiser.
#pragma once

#include <vector>

#include "codec/stream.h"

namespace stgs {

// Returns the attributes of a set as the bits of its floats, in file order.
std::vector<Integers> lossless_integers(const Gaussians4D& set);

// Inserts the SH degree of each primitive, above which all its integers are 0, and reduces the SH
// of each degree to the primitives that have it (spec 6.3).
void add_sh_degrees(std::vector<Integers>& integers);

}  // namespace stgs
