// SPDX-License-Identifier: Apache-2.0
// Locks of open files, and files that change their name meanwhile.
#pragma once

#include <string>

namespace stgs::os {

enum class LockResult {
  kTaken,
  kBusy,         // another open file has it
  kUnavailable,  // the file system has no locks
};

// Locks an open file (flock) without waiting, until its last descriptor is closed.
LockResult try_lock(int descriptor);

// Returns whether `path` names the descriptor's file; a link to it does not count.
bool is_named(int descriptor, const std::string& path);

// Deletes a folder with its contents, its file `lock` last. Follows no links, and leaves what it
// cannot remove. Returns whether the folder is gone.
bool remove_folder(const std::string& path) noexcept;

}  // namespace stgs::os
