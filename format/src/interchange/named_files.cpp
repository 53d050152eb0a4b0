// SPDX-License-Identifier: Apache-2.0
#include "interchange/named_files.h"

#include <unistd.h>
#include <zip.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <new>
#include <optional>

#include "core/bytes.h"
#include "interchange/compression.h"
#include "os/regular_file.h"
#include "stgs/format/byte_source.h"

namespace stgs {
namespace {

// Memory of libzip for each byte of the list of members: an entry of at least 46 bytes takes less
// than 400, with its name and its place in a table, and an extra field of at least 4 bytes 64.
constexpr std::uint64_t kBytesPerDirectoryByte = 16;
// Bytes that can be read from an archive in total: images of SOG models hardly compress further.
constexpr std::uint64_t kReadInAnyArchive = 256 << 20, kReadPerByte = 64;

// Returns whether a name stays inside the set: relative, without "..", without a zero byte.
bool stays_inside(const std::string& name) {
  if (name.empty() || name.find('\0') != std::string::npos) return false;
  const std::filesystem::path path(name);
  return path.is_relative() && std::find(path.begin(), path.end(), "..") == path.end();
}

class FolderFiles final : public NamedFiles {
 public:
  explicit FolderFiles(std::string folder) : folder_(std::move(folder)) {}

  std::string label(const std::string& name) const override {
    return (std::filesystem::path(folder_) / name).string();
  }

  Result<ChargedBytes> read(const std::string& name, ImportMemory& memory,
                            std::uint64_t max_bytes) override {
    if (!stays_inside(name)) {
      return invalid_file("{}: refers to a file outside the folder: \"{}\"", folder_, name);
    }
    STGS_ASSIGN(const std::unique_ptr<ByteSource> file, open_file(label(name)));
    STGS_TRY(check_size(name, file->size(), max_bytes));
    ChargedBytes out;
    STGS_ASSIGN(out.lease, memory.take(file->size(), "the bytes of " + name));
    out.value.resize(static_cast<std::size_t>(file->size()));
    STGS_TRY(file->read(0, out.value));
    return out;
  }

 private:
  std::string folder_;
};

// Returns the status of an error of libzip. `what` failed.
Status status_of(zip_error_t& error, const std::string& what) {
  const int code = zip_error_code_zip(&error);
  if (code == ZIP_ER_MEMORY) throw std::bad_alloc();
  const char* const text = zip_error_strerror(&error);
  const bool is_io = code == ZIP_ER_OPEN || code == ZIP_ER_READ || code == ZIP_ER_SEEK;
  return is_io ? io_error("{}: {}", what, text) : invalid_file("{}: {}", what, text);
}

struct CloseArchive {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
struct CloseMember {
  void operator()(zip_file_t* member) const { zip_fclose(member); }
};

class ZipFiles final : public NamedFiles {
 public:
  // `bytes`: of the archive.
  ZipFiles(zip_t* archive, std::string path, std::uint64_t bytes, Lease lease)
      : lease_(std::move(lease)),
        archive_(archive),
        path_(std::move(path)),
        readable_(kReadInAnyArchive + kReadPerByte * bytes) {}

  std::string label(const std::string& name) const override { return path_ + ":" + name; }

  Result<ChargedBytes> read(const std::string& name, ImportMemory& memory,
                            std::uint64_t max_bytes) override {
    if (!stays_inside(name)) {
      return invalid_file("{}: refers to a file outside the archive: \"{}\"", path_, name);
    }
    zip_stat_t stat;
    if (zip_stat(archive_.get(), name.c_str(), 0, &stat) != 0) {
      return invalid_file("{}: not found in the archive", label(name));
    }
    if (!(stat.valid & ZIP_STAT_SIZE) || !(stat.valid & ZIP_STAT_COMP_SIZE)) {
      return invalid_file("{}: the archive does not state its size", label(name));
    }
    STGS_TRY(check_size(name, stat.size, max_bytes));
    const bool is_stored = (stat.valid & ZIP_STAT_COMP_METHOD) && stat.comp_method == ZIP_CM_STORE;
    if (stat.size / kDeflateRatio > stat.comp_size || (is_stored && stat.size != stat.comp_size)) {
      return invalid_file("{}: stated size of {} bytes is impossible for {} compressed bytes",
                          label(name), stat.size, stat.comp_size);
    }
    if (stat.size > readable_) {
      return unsupported("{}: too many bytes are read from the archive, for its size", label(name));
    }
    readable_ -= stat.size;
    const std::unique_ptr<zip_file_t, CloseMember> member(
        zip_fopen(archive_.get(), name.c_str(), 0));
    if (!member) {
      return status_of(*zip_get_error(archive_.get()), label(name) + ": cannot open");
    }
    ChargedBytes out;
    STGS_ASSIGN(out.lease, memory.take(stat.size + kInflateScratch, "the bytes of " + name));
    std::vector<std::uint8_t>& bytes = out.value;
    bytes.resize(static_cast<std::size_t>(stat.size));
    std::uint8_t past_the_end = 0;  // libzip verifies the checksum when the end is read
    if (zip_fread(member.get(), bytes.data(), bytes.size()) != zip_int64_t(bytes.size()) ||
        zip_fread(member.get(), &past_the_end, 1) != 0) {
      return status_of(*zip_file_get_error(member.get()), label(name) + ": damaged in the archive");
    }
    out.lease.resize(stat.size);
    return out;
  }

 private:
  Lease lease_;  // of the list of members
  std::unique_ptr<zip_t, CloseArchive> archive_;
  std::string path_;
  std::uint64_t readable_;  // bytes
};

// Returns the size of a list of members by the end record of a 64-bit archive; nothing if there is
// none. `at`: bytes that may be its locator.
Result<std::optional<std::uint64_t>> directory_bytes64(const ByteSource& file,
                                                       std::span<const std::uint8_t> at) {
  constexpr std::uint32_t kEnd64 = 0x06064B50, kLocator64 = 0x07064B50;  // signatures
  constexpr std::uint64_t kEnd64Bytes = 56;
  constexpr std::size_t kOffset = 8, kEnd64Size = 40;  // offsets of fields
  if (ByteReader(at).u32() != kLocator64) return std::optional<std::uint64_t>();
  const std::uint64_t offset = ByteReader(at.subspan(kOffset)).u64();
  if (offset > file.size() || file.size() - offset < kEnd64Bytes) return std::optional(file.size());
  std::array<std::uint8_t, kEnd64Bytes> end;
  STGS_TRY(file.read(offset, end));
  if (ByteReader(end).u32() != kEnd64) return std::optional(file.size());
  return std::optional(ByteReader(std::span(end).subspan(kEnd64Size)).u64());
}

// Returns the greatest size of a list of members that the end of a file states, bytes: libzip tries
// to read each of those lists, until one is valid. kInvalidFile if the lists together have more
// than twice the bytes of the file, with the memory that their entries take first.
Result<std::uint64_t> directory_bytes(const ByteSource& file) {
  constexpr std::uint32_t kEnd = 0x06054B50;                           // signature
  constexpr std::size_t kEntries = 10, kEndSize = 12, kEndBytes = 22;  // offsets, and all bytes
  constexpr std::uint64_t kMaxComment = 65536, kLocatorBytes = 20;
  constexpr std::uint64_t kEntryMemory = 32, kAnyFile = 64 << 10;
  constexpr std::uint64_t kMaxTail = kLocatorBytes + kEndBytes + kMaxComment;
  std::vector<std::uint8_t> tail(static_cast<std::size_t>(std::min(file.size(), kMaxTail)));
  STGS_TRY(file.read(file.size() - tail.size(), tail));
  std::uint64_t most = 0, tried = 0;
  for (std::size_t at = 0; at + kEndBytes <= tail.size(); ++at) {
    const std::span<const std::uint8_t> here = std::span(tail).subspan(at);
    if (ByteReader(here).u32() != kEnd) continue;
    std::uint64_t size = ByteReader(here.subspan(kEndSize)).u32();
    if (at >= kLocatorBytes) {
      STGS_ASSIGN(const auto size64,
                  directory_bytes64(file, std::span(tail).subspan(at - kLocatorBytes)));
      size = size64.value_or(size);
    }
    most = std::max(most, size);
    tried += std::min(size, file.size()) + kEntryMemory * ByteReader(here.subspan(kEntries)).u16();
  }
  if (tried > 2 * file.size() + kAnyFile) {
    return invalid_file("{}: damaged zip archive, which ends with several lists of its members",
                        file.name());
  }
  return std::min(most, file.size());
}

}  // namespace

std::unique_ptr<NamedFiles> folder_files(const std::string& folder) {
  return std::make_unique<FolderFiles>(folder.empty() ? "." : folder);
}

Result<std::unique_ptr<NamedFiles>> zip_files(const std::string& path, ImportMemory& memory) {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_file(path));
  STGS_ASSIGN(const std::uint64_t directory, directory_bytes(*source));
  STGS_ASSIGN(Lease lease, memory.take(kBytesPerDirectoryByte * directory,
                                       "the names of the members of the archive"));
  STGS_ASSIGN(const int file, os::open_regular(path));
  int code = 0;
  zip_t* archive = zip_fdopen(file, 0, &code);  // which then owns the descriptor
  if (archive == nullptr) {
    ::close(file);
    zip_error_t error;
    zip_error_init_with_code(&error, code);
    const Status status = status_of(error, path + ": cannot read as a zip archive");
    zip_error_fini(&error);
    return status;
  }
  return std::unique_ptr<NamedFiles>(
      std::make_unique<ZipFiles>(archive, path, source->size(), std::move(lease)));
}

}  // namespace stgs
