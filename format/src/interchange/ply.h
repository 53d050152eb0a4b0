// SPDX-License-Identifier: Apache-2.0
// The two kinds of PLY that hold Gaussian splats.
#pragma once

#include "interchange/import.h"
#include "stgs/format/ply_header.h"

namespace stgs {

// The degree that so many coefficients a channel beyond the first make; -1 for other numbers.
int sh_degree_of(std::uint64_t rest_coefficients);

// Whether the header is that of PlayCanvas's packed PLY.
bool is_packed_ply(const PlyHeader& header);
Result<Gaussians4D> read_packed_ply(const ByteSource& source, const PlyHeader& header,
                                    const ReadLimits& limits);

}  // namespace stgs
