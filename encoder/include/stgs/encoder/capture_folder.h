// SPDX-License-Identifier: Apache-2.0
// The folder of a capture: the only files that a capture may name.
//
// Captures are shared, so their tables and links are untrusted. Every file of a capture is opened
// here: below the folder, without following a link that leaves it, and only if it is a regular
// file. The bytes come from the descriptor that was checked. The folder itself may be a link.
#pragma once

#include <sys/types.h>

#include <compare>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Limits of captures, source and prepared, checked while they are read and before work starts.
struct CaptureLimits {
  std::size_t cameras = 1000;
  int frames = 1'000'000;  // of a camera
  // Of a table or calibration (JSON, YAML, XML, TOML, NumPy) and of a file of a text model of
  // COLMAP.
  std::uint64_t table_bytes = std::uint64_t{64} << 20;
  std::uint64_t prepared_bytes = std::uint64_t{4} << 20;  // of capture.json
  // Of an image, a file of a binary model of COLMAP, or a flow file.
  std::uint64_t file_bytes = std::uint64_t{1} << 30;
};
inline constexpr CaptureLimits kCaptureLimits;

// Return kInvalidFile beyond a limit. `where` begins the message.
Status check_camera_limit(std::size_t cameras, const std::string& where);
Status check_frame_limit(std::uint64_t frames, const std::string& where);

// Returns whether a name has no control characters, so that it can be shown and be a file name.
bool is_printable(std::string_view name);

// Identifies a file or folder, whatever path or link leads to it.
struct FileId {
  dev_t device = 0;
  ino_t inode = 0;
  auto operator<=>(const FileId&) const = default;
};

// Changes when a file is written.
struct FileVersion {
  FileId id;
  std::int64_t bytes = 0;
  std::int64_t seconds = 0, nanoseconds = 0;  // of the last change
  auto operator<=>(const FileVersion&) const = default;
};

// An open regular file. Owns the descriptor.
class CaptureFile {
 public:
  explicit CaptureFile(int descriptor) : descriptor_(descriptor) {}
  ~CaptureFile();
  CaptureFile(CaptureFile&& other) noexcept : descriptor_(other.release()) {}
  CaptureFile& operator=(CaptureFile&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  CaptureFile(const CaptureFile&) = delete;
  CaptureFile& operator=(const CaptureFile&) = delete;

  int descriptor() const { return descriptor_; }
  // Gives up the ownership.
  int release();
  // Returns a path of this open file, for libraries that open by name. Valid while the object is.
  std::string name() const;
  // Returns the present version. kIo, with `path` in the message, if the system does not state it.
  Result<FileVersion> version(const std::string& path) const;

 private:
  int descriptor_;
};

// Thread-safe. Paths are the path of the folder, "/" and a name below it.
class CaptureFolder {
 public:
  enum class Kind {
    kMissing,
    kFile,
    kFolder,
    kOther,    // a pipe, socket or device
    kOutside,  // a link that leaves the folder
  };
  enum class Lookup {
    kKernel,      // openat2; kComponents if the kernel has none or forbids it
    kComponents,  // one component at a time, without links
  };
  struct Entry {
    std::string name;
    Kind kind;  // never kMissing
  };
  using Entries = std::vector<Entry>;

  // Opens the folder `path`. With `allow_outside`, paths and links may leave the folder. kIo if it
  // cannot be opened.
  static Result<std::shared_ptr<const CaptureFolder>> open(const std::string& path,
                                                           bool allow_outside,
                                                           Lookup lookup = Lookup::kKernel);
  ~CaptureFolder();
  CaptureFolder(const CaptureFolder&) = delete;
  CaptureFolder& operator=(const CaptureFolder&) = delete;

  const std::string& path() const { return path_; }

  // Returns the path of a file that the capture names, relative to the folder. `where` states the
  // file and key that name it. kInvalidFile if the name leaves the folder, or has a control
  // character.
  Result<std::string> path_of(const std::string& name, const std::string& where) const;

  // Returns the kind of a file. Follows links.
  Kind kind(const std::string& path) const;
  bool exists(const std::string& path) const { return kind(path) != Kind::kMissing; }
  // Also true for a link to the outside, which list() refuses.
  bool is_folder(const std::string& path) const {
    const Kind found = kind(path);
    return found == Kind::kFolder || found == Kind::kOutside;
  }

  // Returns the identity of the file or folder that a path leads to. kIo if there is none,
  // kInvalidFile if it is outside.
  Result<FileId> id(const std::string& path) const;

  // Returns the entries of a folder in any order, without hidden ones; none if there is no such
  // folder. Each folder is read once. kInvalidFile for a folder outside.
  Result<std::shared_ptr<const Entries>> list(const std::string& path) const;

  // Opens a regular file; never waits. kIo if it is missing or not a regular file, kInvalidFile if
  // it is outside.
  Result<CaptureFile> open_file(const std::string& path) const;
  Result<std::unique_ptr<ByteSource>> open_source(const std::string& path) const;
  // Reads a whole file. kInvalidFile for more than `max_bytes`.
  Result<std::vector<std::uint8_t>> read(const std::string& path, std::uint64_t max_bytes) const;

 private:
  CaptureFolder(std::string path, int descriptor, bool allow_outside, Lookup lookup)
      : path_(std::move(path)),
        descriptor_(descriptor),
        allow_outside_(allow_outside),
        lookup_(lookup) {}

  int open_below(const std::string& path, int flags) const;
  Status explain(const std::string& path, int error) const;
  Kind kind_below(int folder, const char* name, const std::string& path) const;

  const std::string path_;
  const int descriptor_;
  const bool allow_outside_;
  const Lookup lookup_;
  mutable std::mutex mutex_;  // of lists_
  mutable std::map<std::string, std::shared_ptr<const Entries>> lists_;
};

// The files or folders that a capture names. The frames of each name are decoded and written, so
// that two names of one file would cost more work than its bytes justify.
class DistinctFiles {
 public:
  // Adds the file or folder at `path`. kInvalidFile if it was added before, under any path; kIo if
  // there is none. `where` begins the message.
  Status add(const CaptureFolder& files, const std::string& path, const std::string& where);

 private:
  std::set<FileId> known_;
};

// The frames of a capture. Links may repeat some images, as those of a camera that missed frames.
class FrameFiles {
 public:
  // Adds the image at `path`. kIo if there is none.
  Status add(const CaptureFolder& files, const std::string& path);
  // kInvalidFile if the frames that repeat an image outnumber the images by more than 30. `where`
  // begins the message.
  Status check(const std::string& where) const;

 private:
  std::set<FileId> known_;
  std::size_t added_ = 0;
};

}  // namespace stgs::encoder
