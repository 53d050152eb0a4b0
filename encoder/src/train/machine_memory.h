// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace stgs::encoder {

// Bytes that this process can still take without swapping: what the machine has available, or less
// where a control group (a container, a Slurm job) allows less.
std::uint64_t available_memory();

}  // namespace stgs::encoder
