// SPDX-License-Identifier: Apache-2.0
// .stgs files as inputs: small seeds of every kind, their units, and repairs.
#pragma once

#include "fuzz_target.h"
#include "stgs/format/scene_file.h"

namespace stgs::fuzz {

// Small, so that a count that is not checked against the file exceeds them.
inline constexpr ReadLimits kStgsLimits{20'000, 256 << 10};

std::vector<Bytes> stgs_seeds();
// Returns the header, the records, and their payloads as units.
std::vector<Unit> stgs_units(View file);
// Repairs the fields that a reader checks first.
Bytes repair_stgs(Bytes file, Repair repair);
// The heap limit: the complete scene, and two segments at a time with their bytes and planes.
std::uint64_t stgs_memory(View input);

}  // namespace stgs::fuzz
