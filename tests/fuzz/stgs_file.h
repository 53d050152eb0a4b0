// SPDX-License-Identifier: Apache-2.0
// .stgs files as inputs: small ones of every kind, their records, their checksums.
#pragma once

#include "fuzz_target.h"
#include "stgs/format/scene_file.h"

namespace stgs::fuzz {

// Small enough that a claim which is not checked against the bytes passes them.
inline constexpr ReadLimits kStgsLimits{20'000, 256 << 10};

std::vector<Bytes> stgs_seeds();
// The header, the records, and their payloads.
std::vector<Unit> stgs_units(View file);
// Repairs what a reader checks before it looks at the rest.
Bytes repair_stgs(Bytes file, Repair repair);
// Two segments at a time are decoded beside the whole scene, each with its bytes and its planes.
std::uint64_t stgs_memory(View input);

}  // namespace stgs::fuzz
