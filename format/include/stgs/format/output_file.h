// SPDX-License-Identifier: Apache-2.0
// Atomic output: files are written under a temporary name (temporary.h) and renamed when complete.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"
#include "stgs/format/temporary.h"

namespace stgs {

// Renames a file, replacing an existing one.
Status rename_over(const std::string& from, const std::string& to);

// A file written piece by piece. Removes its temporary file unless committed. One thread at a time.
class OutputFile {
 public:
  OutputFile() = default;
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  // Opens a temporary file for `path`. A character device or a pipe is written directly, because a
  // rename would replace it by a file. Disks and sockets are refused.
  Status open(const std::string& path);
  // Appends bytes.
  Status write(std::span<const std::uint8_t> bytes);
  // Syncs and renames. After an error (full disk, read-only folder) no file is left behind.
  Status commit();
  // As commit(), but leaves the file open: write() appends to it, whatever its name leads to.
  Status publish();

 private:
  Status sync();
  int descriptor() const { return device_ >= 0 ? device_ : temporary_.descriptor(); }

  std::string path_;
  TemporaryFile temporary_;
  int device_ = -1;
};

// Writes a complete file with OutputFile. Afterwards `path` is the old file or the complete new
// one.
Status write_file_atomically(const std::string& path, std::span<const std::uint8_t> bytes);

// A file that is only appended to and may be read meanwhile. It is locked (flock) from before the
// first read or write until it is closed, so it has a single writer. One thread at a time.
class AppendedFile {
 public:
  AppendedFile() = default;
  ~AppendedFile();
  AppendedFile(const AppendedFile&) = delete;
  AppendedFile& operator=(const AppendedFile&) = delete;

  // Creates a file with these bytes; it must not exist. After an error it does not exist. With
  // `sync` it returns once the bytes and the file's name are on disk.
  Status create(const std::string& path, std::span<const std::uint8_t> bytes, bool sync);
  // Opens an existing file. kUsage if another AppendedFile has it open.
  Status open(const std::string& path);
  // Returns the content. Nobody else appends to it or truncates it.
  Result<std::unique_ptr<ByteSource>> source() const;
  // Truncates the file to its first `bytes`.
  Status cut(std::uint64_t bytes);
  // Appends bytes. With `sync` it returns once they are on disk. After an error the file is
  // truncated to its previous length, if possible, and closed.
  Status append(std::span<const std::uint8_t> bytes, bool sync);
  // Closes the file and releases the lock.
  Status close();

  const std::string& path() const { return path_; }
  // Returns the length in bytes.
  std::uint64_t bytes() const { return bytes_; }

 private:
  Status lock();
  void release();

  std::string path_;
  int fd_ = -1;
  std::uint64_t bytes_ = 0;
  bool unfinished_ = false;  // created here, and not complete yet
};

}  // namespace stgs
