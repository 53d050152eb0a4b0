// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>

namespace stgs::encoder {

// Returns the bytes that this process can still allocate without swapping: the machine's available
// memory, or less if a control group (a container, a Slurm job) sets a lower limit.
std::uint64_t available_memory();

// Returns the bytes left by a control group (a path relative to `root`, the mount point of cgroup
// v2) and its ancestors; 2^64 - 1 if none has a limit. Cached files count as free, because the
// kernel reclaims them first. Shared memory (tmpfs) does not, although the kernel includes it in
// the cached files, because it cannot be reclaimed.
std::uint64_t cgroup_available_memory(const std::filesystem::path& root,
                                      std::filesystem::path group);

}  // namespace stgs::encoder
