// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>

namespace stgs::encoder {

// Bytes that this process can still take without swapping: what the machine has available, or less
// where a control group (a container, a Slurm job) allows less.
std::uint64_t available_memory();

// What a control group (a path relative to `root`, where cgroup v2 is mounted) and those around it
// leave; 2^64 - 1 where none has a limit. Cached files count as free, for the kernel gives them up
// first; shared memory (tmpfs), which it counts among them, does not, for it cannot.
std::uint64_t cgroup_available_memory(const std::filesystem::path& root,
                                      std::filesystem::path group);

}  // namespace stgs::encoder
