// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/capture_folder.h"

#include <dirent.h>
#include <fcntl.h>
#include <linux/openat2.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>

#include "stgs/format/text.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

// Flags of every open of a file: it must not wait for the writer of a pipe.
constexpr int kOpenFlags = O_CLOEXEC | O_NOCTTY | O_NONBLOCK;

// As openat2(), and retries if a rename interferes.
int open_beneath(int folder, const char* name, int flags) {
  constexpr int kTries = 16;
  open_how how{};
  how.flags = static_cast<std::uint64_t>(flags);
  how.resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS;
  long opened = -1;
  for (int i = 0; i < kTries; ++i) {
    opened = ::syscall(SYS_openat2, folder, name, &how, sizeof how);
    if (opened >= 0 || (errno != EAGAIN && errno != EINTR)) break;
  }
  return static_cast<int>(opened);
}

// Opens one component after another. A link fails with EXDEV, wherever it leads.
int open_components(int folder, const std::string& name, int flags) {
  CaptureFile at(::fcntl(folder, F_DUPFD_CLOEXEC, 0));
  std::size_t begin = 0;
  while (at.descriptor() >= 0) {
    const std::size_t end = std::min(name.find('/', begin), name.size());
    const std::string component = name.substr(begin, end - begin);
    const bool last = end == name.size();
    struct stat info {};
    if (::fstatat(at.descriptor(), component.c_str(), &info, AT_SYMLINK_NOFOLLOW) == 0 &&
        S_ISLNK(info.st_mode)) {
      errno = EXDEV;
      return -1;
    }
    const int wanted = (last ? flags : O_PATH | O_DIRECTORY | O_CLOEXEC) | O_NOFOLLOW;
    CaptureFile next(::openat(at.descriptor(), component.c_str(), wanted));
    if (last) return next.release();
    if (next.descriptor() < 0) return -1;
    at = std::move(next);
    begin = end + 1;
  }
  return -1;
}

CaptureFolder::Kind kind_of(mode_t mode) {
  using Kind = CaptureFolder::Kind;
  return S_ISREG(mode) ? Kind::kFile : S_ISDIR(mode) ? Kind::kFolder : Kind::kOther;
}

bool is_refusal(int error) {
  return error == EXDEV || error == ELOOP;
}

Status outside(const std::string& path) {
  return invalid_file(
      "{}: leads out of the capture's folder; copy the file into the folder, or trust the capture "
      "with --allow-outside",
      path);
}

}  // namespace

Status check_camera_limit(std::size_t cameras, const std::string& where) {
  if (cameras <= kCaptureLimits.cameras) return {};
  return invalid_file("{}: too many cameras (limit {})", where, kCaptureLimits.cameras);
}

Status check_frame_limit(std::uint64_t frames, const std::string& where) {
  if (frames <= static_cast<std::uint64_t>(kCaptureLimits.frames)) return {};
  return invalid_file("{}: {} frames (limit {} per camera)", where, frames, kCaptureLimits.frames);
}

bool is_printable(std::string_view name) {
  return std::none_of(name.begin(), name.end(),
                      [](unsigned char c) { return c < 0x20 || c == 0x7f; });
}

CaptureFile::~CaptureFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

int CaptureFile::release() {
  return std::exchange(descriptor_, -1);
}

std::string CaptureFile::name() const {
  return fmt::format("/proc/self/fd/{}", descriptor_);
}

Result<FileVersion> CaptureFile::version(const std::string& path) const {
  struct stat info = {};
  if (::fstat(descriptor_, &info) != 0) {
    return io_error("{}: cannot read: {}", path, system_message(errno));
  }
  return FileVersion{
      {info.st_dev, info.st_ino}, info.st_size, info.st_mtim.tv_sec, info.st_mtim.tv_nsec};
}

Result<std::shared_ptr<const CaptureFolder>> CaptureFolder::open(const std::string& path,
                                                                 bool allow_outside,
                                                                 Lookup lookup) {
  const int descriptor = ::open(path.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return io_error("{}: cannot open: {}", path, file_problem(errno));
  CaptureFile owned(descriptor);
  if (lookup == Lookup::kKernel) {
    const CaptureFile probe(open_beneath(descriptor, ".", O_PATH | O_CLOEXEC));
    if (probe.descriptor() < 0) lookup = Lookup::kComponents;
  }
  std::shared_ptr<const CaptureFolder> folder(
      new CaptureFolder(path, descriptor, allow_outside, lookup));
  (void)owned.release();
  return folder;
}

CaptureFolder::~CaptureFolder() {
  ::close(descriptor_);
}

Result<std::string> CaptureFolder::path_of(const std::string& name,
                                           const std::string& where) const {
  if (!is_printable(name) || name.empty()) {
    return invalid_file("{}: the file name is empty or has a control character", where);
  }
  const fs::path below = fs::path(name).lexically_normal();
  if (allow_outside_) return (fs::path(path_) / below).string();
  if (below.is_absolute() || *below.begin() == "..") {
    return invalid_file(
        "{}: '{}' leads out of the capture's folder; name a file in the folder, or trust the "
        "capture with --allow-outside",
        where, name);
  }
  return path_ + "/" + below.string();
}

// Returns a descriptor, or -1 and errno. EXDEV: outside.
int CaptureFolder::open_below(const std::string& path, int flags) const {
  if (path.find('\0') != std::string::npos) {
    errno = ENOENT;
    return -1;
  }
  if (allow_outside_) return ::open(path.c_str(), flags);
  fs::path name = ".";
  if (path != path_) {
    if (path.compare(0, path_.size() + 1, path_ + "/") != 0) {
      errno = EXDEV;
      return -1;
    }
    name = fs::path(path.substr(path_.size() + 1)).relative_path();
  }
  for (const fs::path& component : name) {
    if (component != "..") continue;
    errno = EXDEV;
    return -1;
  }
  name = name.lexically_normal();
  if (name.empty()) name = ".";
  if (lookup_ == Lookup::kComponents) return open_components(descriptor_, name.string(), flags);
  return open_beneath(descriptor_, name.c_str(), flags);
}

Status CaptureFolder::explain(const std::string& path, int error) const {
  if (!allow_outside_ && is_refusal(error)) return outside(path);
  return io_error("{}: cannot open: {}", path, file_problem(error));
}

CaptureFolder::Kind CaptureFolder::kind(const std::string& path) const {
  const CaptureFile file(open_below(path, O_PATH | O_CLOEXEC));
  if (file.descriptor() < 0) {
    return !allow_outside_ && is_refusal(errno) ? Kind::kOutside : Kind::kMissing;
  }
  struct stat info {};
  return ::fstat(file.descriptor(), &info) == 0 ? kind_of(info.st_mode) : Kind::kMissing;
}

Result<FileId> CaptureFolder::id(const std::string& path) const {
  const CaptureFile file(open_below(path, O_PATH | O_CLOEXEC));
  struct stat info {};
  if (file.descriptor() < 0 || ::fstat(file.descriptor(), &info) != 0) return explain(path, errno);
  return FileId{info.st_dev, info.st_ino};
}

// Returns the kind of the entry `name` of an open folder, whose path is `path`.
CaptureFolder::Kind CaptureFolder::kind_below(int folder, const char* name,
                                              const std::string& path) const {
  struct stat info {};
  if (::fstatat(folder, name, &info, AT_SYMLINK_NOFOLLOW) != 0) return Kind::kMissing;
  return S_ISLNK(info.st_mode) ? kind(path + "/" + name) : kind_of(info.st_mode);
}

Result<std::shared_ptr<const CaptureFolder::Entries>> CaptureFolder::list(
    const std::string& path) const {
  const std::lock_guard lock(mutex_);
  if (const auto known = lists_.find(path); known != lists_.end()) return known->second;
  auto entries = std::make_shared<Entries>();
  CaptureFile folder(open_below(path, O_RDONLY | O_DIRECTORY | kOpenFlags));
  if (folder.descriptor() < 0) {
    const bool none = errno == ENOENT || errno == ENOTDIR || errno == ENAMETOOLONG;
    if (!none) return explain(path, errno);
  } else {
    DIR* const opened = ::fdopendir(folder.descriptor());
    if (opened == nullptr) return explain(path, errno);
    (void)folder.release();
    const std::unique_ptr<DIR, int (*)(DIR*)> stream(opened, &::closedir);
    for (;;) {
      errno = 0;
      const dirent* const entry = ::readdir(opened);
      if (entry == nullptr && errno != 0) return explain(path, errno);
      if (entry == nullptr) break;
      if (entry->d_name[0] == '.') continue;
      const bool known = entry->d_type == DT_REG || entry->d_type == DT_DIR;
      const Kind kind = known ? (entry->d_type == DT_REG ? Kind::kFile : Kind::kFolder)
                              : kind_below(::dirfd(opened), entry->d_name, path);
      if (kind != Kind::kMissing) entries->push_back({entry->d_name, kind});
    }
  }
  lists_.emplace(path, entries);
  return std::shared_ptr<const Entries>(entries);
}

Result<CaptureFile> CaptureFolder::open_file(const std::string& path) const {
  // Before the file is opened, because opening a device can have effects.
  if (kind(path) == Kind::kOther) return io_error("{}: not a regular file", path);
  CaptureFile file(open_below(path, O_RDONLY | kOpenFlags));
  if (file.descriptor() < 0) return explain(path, errno);
  STGS_TRY(check_regular(file.descriptor(), path));
  return file;
}

Result<std::unique_ptr<ByteSource>> CaptureFolder::open_source(const std::string& path) const {
  STGS_ASSIGN(CaptureFile file, open_file(path));
  return descriptor_source(file.release(), path);
}

Result<std::vector<std::uint8_t>> CaptureFolder::read(const std::string& path,
                                                      std::uint64_t max_bytes) const {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_source(path));
  if (source->size() > max_bytes) {
    return invalid_file("{}: file too large: {} bytes (limit {})", path, source->size(), max_bytes);
  }
  std::vector<std::uint8_t> bytes(source->size());
  STGS_TRY(source->read(0, bytes));
  return bytes;
}

Status DistinctFiles::add(const CaptureFolder& files, const std::string& path,
                          const std::string& where) {
  STGS_ASSIGN(const FileId id, files.id(path));
  if (known_.insert(id).second) return {};
  return invalid_file(
      "{}: {} was named before, or leads to a file or folder that was; name each once", where,
      path);
}

Status FrameFiles::add(const CaptureFolder& files, const std::string& path) {
  STGS_ASSIGN(const FileId id, files.id(path));
  known_.insert(id);
  ++added_;
  return {};
}

Status FrameFiles::check(const std::string& where) const {
  constexpr std::size_t kFreeRepeats = 30;
  if (added_ <= 2 * known_.size() + kFreeRepeats) return {};
  return invalid_file(
      "{}: {} frames are links to {} images; replace the links by copies of the images", where,
      added_, known_.size());
}

}  // namespace stgs::encoder
