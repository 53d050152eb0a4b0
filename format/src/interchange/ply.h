// SPDX-License-Identifier: Apache-2.0
// The two kinds of PLY that contain Gaussian splats.
#pragma once

#include "interchange/import.h"
#include "stgs/format/ply_header.h"

namespace stgs {

// Returns the SH degree, up to 4, with this many coefficients per channel beyond the first; -1 if
// there is none.
int sh_degree_of(std::uint64_t rest_coefficients);

// Reads the vertices of a 3DGS PLY, with lifespans that are 0. Properties besides those of 3DGS are
// skipped.
Result<Charged<Gaussians4D>> read_ply_vertices(const ByteSource& source, const PlyHeader& header,
                                               ImportMemory& memory, ConversionNotes* notes);
// Reads a PLY of either kind.
Result<Charged<Scene>> read_ply_scene(const ByteSource& source, ImportMemory& memory,
                                      ConversionNotes* notes);

// Returns whether the header is that of a packed PLY of PlayCanvas.
bool is_packed_ply(const PlyHeader& header);
Result<Charged<Gaussians4D>> read_packed_ply(const ByteSource& source, const PlyHeader& header,
                                             ImportMemory& memory);

}  // namespace stgs
