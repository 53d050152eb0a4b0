// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/program_module.h"

#include <dlfcn.h>
#include <link.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <string>
#include <vector>

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

// Relative to the folder of the program, or of the library that contains this code: next to it in a
// build, a module folder if installed.
constexpr const char* kProgramFolders[] = {".", STGS_MODULE_FOLDER};
constexpr const char* kLibraryFolders[] = {".", STGS_LIBRARY_MODULE_FOLDER};

struct ModulePlaces {
  std::vector<fs::path> folders;
  uid_t owner = 0;  // of the program or library
};

// Returns the folders that may hold modules.
Result<ModulePlaces> module_places() {
  Dl_info info{};
  void* map = nullptr;
  const auto* here = reinterpret_cast<const void*>(&load_program_module);
  if (::dladdr1(here, &info, &map, RTLD_DL_LINKMAP) == 0 || map == nullptr) {
    return runtime_error("cannot find the folder of the modules");
  }
  const std::string library = static_cast<const link_map*>(map)->l_name;
  std::error_code error;
  const fs::path file =
      library.empty() ? fs::read_symlink("/proc/self/exe", error) : fs::canonical(library, error);
  if (error) {
    return io_error("{}: cannot read: {}", library.empty() ? "/proc/self/exe" : library,
                    error.message());
  }
  ModulePlaces places;
  struct stat status {};
  if (::stat(file.c_str(), &status) == 0) places.owner = status.st_uid;
  for (const char* folder : library.empty() ? kProgramFolders : kLibraryFolders) {
    places.folders.push_back((file.parent_path() / folder / "").lexically_normal().parent_path());
  }
  return places;
}

// Returns whether every user can change a file or the names in a folder.
bool is_open_to_all(const fs::path& path, bool allow_sticky) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) return true;
  return (status.st_mode & S_IWOTH) != 0 && !(allow_sticky && (status.st_mode & S_ISVTX) != 0);
}

// Returns whether a file or folder belongs to root, this user, or `owner`.
bool is_trusted(const fs::path& path, uid_t owner) {
  struct stat status {};
  return ::stat(path.c_str(), &status) == 0 &&
         (status.st_uid == 0 || status.st_uid == ::geteuid() || status.st_uid == owner);
}

// Returns whether the module can be that of a user other than root, this one and `owner`, that of
// the program. A sticky folder protects the names in it, but allows new ones: that is enough for a
// folder above the module's.
bool is_replaceable(const fs::path& path, uid_t owner) {
  const fs::path folder = path.parent_path();
  if (!is_trusted(path, owner) || !is_trusted(folder, owner)) return true;
  if (is_open_to_all(path, false) || is_open_to_all(folder, false)) return true;
  for (fs::path above = folder; above.has_relative_path();) {
    above = above.parent_path();
    if (is_open_to_all(above, true)) return true;
  }
  return false;
}

}  // namespace

Result<void*> load_program_module(const std::string& file, const char* symbol, bool global) {
  STGS_ASSIGN(const ModulePlaces places, module_places());
  std::error_code error;
  std::string folders;
  std::string problem;
  for (const fs::path& folder : places.folders) {
    const fs::path path = folder / file;
    folders += (folders.empty() ? "" : " or ") + folder.string();
    if (!fs::exists(path, error)) continue;
    if (is_replaceable(path, places.owner)) {
      problem = fmt::format(
          "{}: not loaded, because other users can replace it; make you or root the owner of the "
          "file and its folder, and run 'chmod o-w' on them and the folders above",
          path.string());
      continue;
    }
    void* const module = ::dlopen(path.c_str(), RTLD_NOW | (global ? RTLD_GLOBAL : RTLD_LOCAL));
    if (module == nullptr) {
      problem = fmt::format("{} could not be loaded: {}", file, ::dlerror());
      continue;
    }
    void* const found = ::dlsym(module, symbol);
    if (found != nullptr) return found;
    problem = fmt::format("{}: belongs to another version of stgs; reinstall it", path.string());
  }
  if (!problem.empty()) return unsupported("{}", problem);
  return unsupported("{} is missing (expected in {}); copy it there, or reinstall stgs", file,
                     folders);
}

}  // namespace stgs::encoder
