// SPDX-License-Identifier: Apache-2.0
#include "output_folder.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "session.h"
#include "stgs/format/output_file.h"
#include "stgs/format/output_path.h"

namespace stgs::tools {
namespace {

namespace fs = std::filesystem;

// A descriptor of a file or folder.
class Opened {
 public:
  explicit Opened(int descriptor) : descriptor_(descriptor) {}
  ~Opened() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  Opened(Opened&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
  Opened& operator=(Opened&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  Opened(const Opened&) = delete;
  Opened& operator=(const Opened&) = delete;
  int get() const { return descriptor_; }

 private:
  int descriptor_;
};

constexpr int kFolderFlags = O_RDONLY | O_DIRECTORY | O_CLOEXEC;

}  // namespace

OutputFolder::OutputFolder(const std::string& folder, encoder::LogSink log)
    : folder_((fs::path(folder) / "").parent_path().string()), log_(std::move(log)) {}

Status OutputFolder::create_work() {
  // An existing folder may be on another disk than the folder that contains it.
  std::error_code error;
  const std::string output = fs::is_directory(folder_, error) ? folder_ + "/files" : folder_;
  clear_leftovers(folder_, log_);
  clear_leftovers(folder_ + "/files", log_);
  STGS_TRY(work_.create(output));
  made_ = work_.path() + "/made";
  if (::mkdir(made_.c_str(), 0777) == 0) return {};
  return io_error("{}: cannot create: {}", folder_, system_message(errno));
}

Result<std::string> OutputFolder::add(const std::string& name) {
  if (made_.empty()) STGS_TRY(create_work());
  std::error_code error;
  fs::create_directories((fs::path(made_) / name).parent_path(), error);
  if (error) return io_error("{}/{}: cannot create: {}", folder_, name, error.message());
  names_.push_back(name);
  return made_ + "/" + name;
}

void OutputFolder::drop(const std::string& name) {
  std::erase(names_, name);
  std::error_code error;
  fs::remove(fs::path(made_) / name, error);  // the work folder is deleted in any case
}

Status OutputFolder::move(int folder, const std::string& name) const {
  const fs::path path(name);
  fs::path parent;
  Opened into(::openat(folder, ".", kFolderFlags));
  for (const fs::path& part : path.parent_path()) {
    parent /= part;
    if (::mkdirat(into.get(), part.c_str(), 0777) != 0 && errno != EEXIST) {
      return io_error("{}/{}: cannot create: {}", folder_, parent.string(), system_message(errno));
    }
    into = Opened(::openat(into.get(), part.c_str(), kFolderFlags | O_NOFOLLOW));
    if (into.get() < 0) {
      return io_error("{}/{}: cannot open the folder: {}; links are not followed", folder_,
                      parent.string(), system_message(errno));
    }
  }
  const std::string from = made_ + "/" + name;
  const Opened file(::open(from.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC));
  if (file.get() >= 0) STGS_TRY(keep_mode(file.get(), folder_ + "/" + name));
  if (::renameat(AT_FDCWD, from.c_str(), into.get(), path.filename().c_str()) == 0) return {};
  return io_error("{}/{}: cannot replace: {}", folder_, name, system_message(errno));
}

Status OutputFolder::move_all() const {
  const Opened folder(::open(folder_.c_str(), kFolderFlags));
  if (folder.get() < 0) {
    return io_error("{}: cannot open the folder: {}", folder_, system_message(errno));
  }
  for (std::size_t moved = 0; moved < names_.size(); ++moved) {
    const Status status = move(folder.get(), names_[moved]);
    if (status.ok()) continue;
    if (moved == 0) return {status.code(), status.message() + "; no file was replaced"};
    return {status.code(),
            fmt::format("{}; {} of {} files are new ({} to {}), the others are as before",
                        status.message(), moved, names_.size(), names_.front(), names_[moved - 1])};
  }
  return {};
}

Status OutputFolder::commit() {
  if (names_.empty()) return {};
  const IgnoredSignals ignored;
  if (interrupted()) return runtime_error("{}: not written", folder_);
  std::error_code error;
  return fs::exists(folder_, error) ? move_all() : rename_over(made_, folder_);
}

}  // namespace stgs::tools
