// SPDX-License-Identifier: Apache-2.0
// Small PNG files: seeds, their chunks, and repaired checksums.
#pragma once

#include <string>

#include "fuzz_target.h"

namespace stgs::fuzz {

// Returns an image of stored (not compressed) pixels, with 1 (grey) or 3 channels of 8 bits.
std::string tiny_png(int width, int height, int channels);

// Returns the chunks of a PNG file as units, from their length to their checksum; none of another
// file.
std::vector<Unit> png_units(View file);
// Returns the file with the checksums of its chunks, and the lengths too if sizes are repaired.
Bytes repair_png(Bytes file, Repair repair);

}  // namespace stgs::fuzz
