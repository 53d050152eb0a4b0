// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/program_module.h"

#include <dlfcn.h>
#include <link.h>
#include <sys/stat.h>

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

// Returns the folders that may hold modules.
Result<std::vector<fs::path>> module_folders() {
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
  std::vector<fs::path> folders;
  for (const char* folder : library.empty() ? kProgramFolders : kLibraryFolders) {
    folders.push_back((file.parent_path() / folder / "").lexically_normal().parent_path());
  }
  return folders;
}

// Returns whether every user can replace files of the folder, or the module itself.
bool is_open_to_all(const fs::path& path) {
  struct stat folder {
  }, file{};
  if (::stat(path.parent_path().c_str(), &folder) != 0 || ::stat(path.c_str(), &file) != 0) {
    return true;
  }
  const bool sticky = (folder.st_mode & S_ISVTX) != 0;
  return ((folder.st_mode & S_IWOTH) != 0 && !sticky) || (file.st_mode & S_IWOTH) != 0;
}

}  // namespace

Result<void*> load_program_module(const std::string& file, const char* symbol, bool global) {
  STGS_ASSIGN(const std::vector<fs::path> places, module_folders());
  std::error_code error;
  std::string folders;
  std::string problem;
  for (const fs::path& folder : places) {
    const fs::path path = folder / file;
    folders += (folders.empty() ? "" : " or ") + folder.string();
    if (!fs::exists(path, error)) continue;
    if (is_open_to_all(path)) {
      problem = fmt::format(
          "{}: not loaded, because every user can replace it; run 'chmod o-w' on "
          "the file and its folder",
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
