// SPDX-License-Identifier: Apache-2.0
#include "video_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <mutex>
#include <set>
#include <span>
#include <vector>

#include "file_kind.h"
#include "matroska_tracks.h"
#include "mov_samples.h"
#include "stgs/format/byte_source.h"

namespace stgs::encoder {
namespace {

// Returns the bytes of a file of `size` bytes without its holes; all if the file system does not
// report them.
std::uint64_t stored_bytes(const CaptureFile& file, std::int64_t size) {
  std::uint64_t bytes = 0;
  for (off_t begin = 0; begin < size;) {
    begin = ::lseek(file.descriptor(), begin, SEEK_DATA);
    if (begin < 0 && errno == ENXIO) break;  // a hole at the end
    const off_t end = begin < 0 ? begin : ::lseek(file.descriptor(), begin, SEEK_HOLE);
    if (end < 0) return static_cast<std::uint64_t>(size);
    bytes += static_cast<std::uint64_t>(end - begin);
    begin = end;
  }
  return bytes;
}

// Files that check_tables() has accepted. A file is opened several times.
class AcceptedFiles {
 public:
  bool has(const FileVersion& version) {
    const std::lock_guard lock(mutex_);
    return files_.contains(version);
  }
  void add(const FileVersion& version) {
    const std::lock_guard lock(mutex_);
    if (files_.size() >= 2 * kCaptureLimits.cameras) files_.clear();
    files_.insert(version);
  }

 private:
  std::mutex mutex_;
  std::set<FileVersion> files_;
};

// Rejects files for which FFmpeg would allocate much more memory than their size. `bytes`: without
// holes.
Status check_tables(const CaptureFile& file, std::span<const std::uint8_t> begin,
                    std::uint64_t bytes, const std::string& path) {
  const bool is_mov = begins_with_box(begin);
  if (!is_mov && !begins_with_matroska(begin)) return {};  // AVI
  const int own = ::fcntl(file.descriptor(), F_DUPFD_CLOEXEC, 0);
  if (own < 0) return io_error("{}: cannot read: {}", path, system_message(errno));
  STGS_ASSIGN(const auto source, descriptor_source(own, path));
  return is_mov ? check_mov_samples(*source, bytes) : check_matroska_tracks(*source);
}

}  // namespace

Result<std::uint64_t> check_video_file(const CaptureFile& file, const std::string& path,
                                       const std::string& what) {
  std::vector<std::uint8_t> begin(kVideoProbeBytes);
  const ssize_t got = ::pread(file.descriptor(), begin.data(), begin.size(), 0);
  if (got < 0) return io_error("{}: cannot read: {}", path, system_message(errno));
  begin.resize(static_cast<std::size_t>(got));
  STGS_TRY(check_video_kind(begin, path, what));
  STGS_ASSIGN(const FileVersion version, file.version(path));
  const std::uint64_t bytes = stored_bytes(file, version.bytes);
  static AcceptedFiles accepted;
  if (!accepted.has(version)) STGS_TRY(check_tables(file, begin, bytes, path));
  accepted.add(version);
  return bytes;
}

}  // namespace stgs::encoder
