// SPDX-License-Identifier: Apache-2.0
// Outputs appear whole or not at all: they are written under a temporary name and renamed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"

namespace stgs {

// The temporary name that belongs to `path` in this process: same folder, same ending, hidden.
std::string temporary_name(const std::string& path);

// Removes what of this type lies beside `path`, is named `before`, a process id, `after`, and
// belongs to a process that has ended on this machine without removing it; returns the names. What
// cannot be removed stays.
std::vector<std::string> remove_stale(const std::string& path, const std::string& before,
                                      const std::string& after, std::filesystem::file_type type);

// Renames, replacing an existing file.
Status rename_over(const std::string& from, const std::string& to);

// A file written piece by piece. Removes its temporary unless committed. One thread at a time.
class OutputFile {
 public:
  OutputFile() = default;
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  // A device or a pipe is written directly: a rename would put a file in its place.
  Status open(const std::string& path);
  // Writes to a descriptor of somebody else, such as standard output; `name` is for messages.
  void borrow(int descriptor, const std::string& name);
  Status write(std::span<const std::uint8_t> bytes);
  // Syncs and renames; after an error (full disk, read-only folder) nothing is left behind.
  Status commit();

 private:
  Status close();

  std::string path_, temporary_;
  int fd_ = -1;
  bool borrowed_ = false;
};

// OutputFile in one go: afterwards `path` is either the old file or the whole new one.
Status write_file_atomically(const std::string& path, std::span<const std::uint8_t> bytes);

// A file that is only appended to, and can be read meanwhile. It is locked (flock) from before its
// first byte is read or written until it is closed, so that it has one writer. One thread at a
// time.
class AppendedFile {
 public:
  AppendedFile() = default;
  ~AppendedFile();
  AppendedFile(const AppendedFile&) = delete;
  AppendedFile& operator=(const AppendedFile&) = delete;

  // Makes a file of these bytes, which must not exist; after an error it does not. `sync`: returns
  // when they and its name are on the disk.
  Status create(const std::string& path, std::span<const std::uint8_t> bytes, bool sync);
  // Opens a file that exists. kUsage where another has it open so.
  Status open(const std::string& path);
  // What it holds: nobody else appends to it or cuts it.
  Result<std::unique_ptr<ByteSource>> source() const;
  // Keeps its first `bytes`.
  Status cut(std::uint64_t bytes);
  // `sync`: returns when the bytes are on the disk. After an error the file is cut to what it had
  // before, where that is possible, and closed.
  Status append(std::span<const std::uint8_t> bytes, bool sync);
  Status close();

  const std::string& path() const { return path_; }
  std::uint64_t bytes() const { return bytes_; }

 private:
  Status lock();
  void release();

  std::string path_;
  int fd_ = -1;
  std::uint64_t bytes_ = 0;
  bool unfinished_ = false;  // made here, and not whole yet
};

}  // namespace stgs
