// SPDX-License-Identifier: Apache-2.0
// Temporary files and folders next to an output, and the lock of an output.
//
// Names are random, so each object has its own, in all processes and on all machines that share the
// folder. An object locks its file (flock) while it exists. What a killed process leaves behind is
// recognised by its free lock, which also works between containers, where process ids do not. On a
// file system without locks leftovers stay.
#pragma once

#include <mutex>
#include <string>
#include <vector>

#include "stgs/format/status.h"

namespace stgs {

// Base of the objects whose files remove_unfinished() removes.
class Unfinished {
 public:
  Unfinished(const Unfinished&) = delete;
  Unfinished& operator=(const Unfinished&) = delete;

 protected:
  Unfinished() = default;
  ~Unfinished() = default;

  using ListLock = std::lock_guard<std::mutex>;

  // Guards the list. A file is created and listed, or renamed and unlisted, under one lock, and is
  // unlisted after its removal: so the process can end at any time without leaving it.
  static std::mutex& list_mutex() noexcept;
  // Adds the object to those that are removed, and takes it out again. Its names must not change in
  // between.
  void list(const ListLock&) noexcept;
  void unlist(const ListLock&) noexcept;

 private:
  friend void remove_unfinished() noexcept;
  virtual void abandon() noexcept = 0;

  Unfinished *before_ = nullptr, *after_ = nullptr;
  bool is_listed_ = false;
};

// Removes the temporary files, work folders and locks of this process, which must end then: from
// now on, other threads wait if they create, complete or remove one. Best effort: files that others
// create in a work folder meanwhile stay for remove_leftovers().
void remove_unfinished() noexcept;

// Gives an open file the permissions of the regular file at `path`, if there is one of the same
// owner, so that the successor of a private file is private.
Status keep_mode(int descriptor, const std::string& path);

// A new file that replaces `path` when it is complete. The destructor removes it otherwise. One
// thread at a time.
class TemporaryFile : private Unfinished {
 public:
  TemporaryFile() = default;
  ~TemporaryFile() { remove(); }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  // Creates the file in the folder of `path`, hidden, with the extension of `path` and the mode of
  // the file that it replaces (keep_mode()). Call once.
  Status create(const std::string& path);
  // Returns the descriptor, open for reading and writing; -1 before create() and after commit().
  // The object owns it.
  int descriptor() const { return descriptor_; }
  // Renames the file to `path`, replacing an existing file, and closes it.
  Status commit();
  // Renames the file, but leaves it open until the destructor.
  Status publish();

 private:
  void remove() noexcept;
  void abandon() noexcept override;

  std::string path_, name_;
  int descriptor_ = -1;
};

// A new folder that only this user can enter, for files that others write by name. The destructor
// deletes it with its contents; it follows no links. One thread at a time.
class WorkFolder : private Unfinished {
 public:
  WorkFolder() = default;
  ~WorkFolder();
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;

  // Creates the folder next to `path`, hidden. It contains a file `lock`. Call once.
  Status create(const std::string& path);
  // Returns the folder; "" before create().
  const std::string& path() const { return path_; }

 private:
  void abandon() noexcept override;

  std::string path_, lock_name_;
  int lock_ = -1;
};

// Makes a run the only one that writes an output, from take() until the destructor.
class OutputLock : private Unfinished {
 public:
  OutputLock() = default;
  ~OutputLock();
  OutputLock(const OutputLock&) = delete;
  OutputLock& operator=(const OutputLock&) = delete;

  // kUsage if another object has the lock of `path`, a file or a folder, in any process. The folder
  // that contains it must exist; a hidden file there, `.NAME.lock`, carries the lock. kUsage if
  // that is not an empty regular file, which this class would not have made. Call once.
  Status take(const std::string& path);

 private:
  void abandon() noexcept override;

  std::string name_;
  int lock_ = -1;
};

// Removes the temporary files and work folders of `path` that no process uses, and returns their
// names. Those that cannot be removed stay.
std::vector<std::string> remove_leftovers(const std::string& path);

}  // namespace stgs
