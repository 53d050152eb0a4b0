// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/byte_source.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>

#include "os/regular_file.h"
#include "stgs/format/text.h"

namespace stgs {
namespace {

Status past_the_end(const std::string& name, std::uint64_t offset, std::uint64_t bytes,
                    std::uint64_t size) {
  return invalid_file("{}: the file is truncated (needs bytes {} to {}, has {} bytes)", name,
                      offset, offset + bytes, size);
}

// Closes the descriptor unless it was passed on.
struct Descriptor {
  int fd;
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
};

class FileSource final : public ByteSource {
 public:
  FileSource(int fd, const struct stat& info, std::string name)
      : fd_(fd), inode_(info), size_(bytes_of(info)), name_(std::move(name)) {}
  ~FileSource() override { ::close(fd_); }

  std::uint64_t size() const override { return size_; }
  const std::string& name() const override { return name_; }

  bool may_grow() const override { return true; }
  Result<Change> refresh(std::uint64_t stable_bytes) override {
    struct stat info {
    }, named{};
    if (::fstat(fd_, &info) != 0) {
      return io_error("{}: cannot get the file size: {}", name_, system_message(errno));
    }
    // A removed file stays readable through the open descriptor.
    const bool other = ::stat(name_.c_str(), &named) == 0 &&
                       (named.st_dev != inode_.st_dev || named.st_ino != inode_.st_ino);
    if (other || bytes_of(info) < stable_bytes) return Change::kReplaced;
    return size_.exchange(bytes_of(info)) == bytes_of(info) ? Change::kNone : Change::kResized;
  }

  bool has_shrunk() const override {
    struct stat info {};
    return ::fstat(fd_, &info) == 0 && bytes_of(info) < size();
  }

  void set_finished() override {
    struct stat info {};
    if (::fstat(fd_, &info) == 0) finished_at_ = written_at(info);
  }
  bool was_modified() const override {
    struct stat info {};
    const std::int64_t before = finished_at_;
    return before != 0 && ::fstat(fd_, &info) == 0 &&
           (bytes_of(info) != size() || written_at(info) != before);
  }

  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    STGS_TRY(check_range(name_, size(), offset, out.size()));
    std::size_t done = 0;
    while (done < out.size()) {
      const ssize_t got =
          ::pread(fd_, out.data() + done, out.size() - done, static_cast<off_t>(offset + done));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return io_error("{}: cannot read: {}", name_, system_message(errno));
      if (got == 0) {
        return io_error("{}: the file was truncated while open (bytes {} to {} are gone)", name_,
                        offset, offset + out.size());
      }
      done += static_cast<std::size_t>(got);
    }
    return {};
  }

 private:
  static std::int64_t written_at(const struct stat& info) {  // nanoseconds
    return std::int64_t{info.st_mtim.tv_sec} * 1'000'000'000 + info.st_mtim.tv_nsec;
  }
  static std::uint64_t bytes_of(const struct stat& info) {
    return static_cast<std::uint64_t>(info.st_size);
  }

  const int fd_;
  const struct stat inode_;  // as of opening
  std::atomic<std::uint64_t> size_;
  std::atomic<std::int64_t> finished_at_ = 0;  // time of the last write; 0: not finished
  const std::string name_;
};

class MemorySource final : public ByteSource {
 public:
  MemorySource(std::vector<std::uint8_t> bytes, std::string name)
      : bytes_(std::move(bytes)), name_(std::move(name)) {}

  std::uint64_t size() const override { return bytes_.size(); }
  const std::string& name() const override { return name_; }

  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    STGS_TRY(check_range(name_, bytes_.size(), offset, out.size()));
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
    return {};
  }

 private:
  std::vector<std::uint8_t> bytes_;
  std::string name_;
};

}  // namespace

Status check_range(const std::string& name, std::uint64_t size, std::uint64_t offset,
                   std::uint64_t bytes) {
  if (offset > size || bytes > size - offset) return past_the_end(name, offset, bytes, size);
  return {};
}

Result<std::unique_ptr<ByteSource>> open_file(const std::string& path) {
  STGS_ASSIGN(const int descriptor, os::open_regular(path));
  return descriptor_source(descriptor, path);
}

Result<std::unique_ptr<ByteSource>> descriptor_source(int fd, const std::string& path) {
  Descriptor ours{fd};
  struct stat info {};  // of no type if it cannot be read
  (void)::fstat(fd, &info);
  STGS_TRY(check_regular(fd, path));
  auto source = std::make_unique<FileSource>(fd, info, path);
  ours.fd = -1;
  return std::unique_ptr<ByteSource>(std::move(source));
}

std::unique_ptr<ByteSource> memory_source(std::vector<std::uint8_t> bytes, std::string name) {
  return std::make_unique<MemorySource>(std::move(bytes), std::move(name));
}

}  // namespace stgs
