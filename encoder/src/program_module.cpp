// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/program_module.h"

#include <dlfcn.h>

#include <filesystem>

namespace stgs::encoder {
namespace {

// Relative to the program's folder: next to the program in a build, a module folder if installed.
constexpr const char* kFolders[] = {".", STGS_MODULE_FOLDER};

}  // namespace

Result<void*> load_program_module(const std::string& file, const char* symbol, bool everyone) {
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) return io_error("/proc/self/exe: cannot read: {}", error.message());
  std::filesystem::path path;
  std::string folders;
  for (const char* folder : kFolders) {
    path = (program.parent_path() / folder / file).lexically_normal();
    if (std::filesystem::exists(path, error)) break;
    folders += (folders.empty() ? "" : " or ") + path.parent_path().string();
    path.clear();
  }
  if (path.empty()) {
    return unsupported("{} is missing (expected in {}); copy it there, or reinstall stgs", file,
                       folders);
  }
  void* const module = ::dlopen(path.c_str(), everyone ? RTLD_NOW | RTLD_GLOBAL : RTLD_LAZY);
  if (module == nullptr) return unsupported("{} could not be loaded: {}", file, ::dlerror());
  void* const found = ::dlsym(module, symbol);
  if (found != nullptr) return found;
  return unsupported("{}: module of another version of stgs; reinstall it", path.string());
}

}  // namespace stgs::encoder
