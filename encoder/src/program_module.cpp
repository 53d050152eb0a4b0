// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/program_module.h"

#include <dlfcn.h>

#include <filesystem>

namespace stgs::encoder {
namespace {

// Relative to the program's folder: next to the program in a build, a module folder if installed.
constexpr const char* kFolders[] = {".", STGS_MODULE_FOLDER};

}  // namespace

Result<void*> load_program_module(const std::string& file, const char* symbol, bool global) {
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) return io_error("/proc/self/exe: cannot read: {}", error.message());
  std::string folders;
  std::string problem;
  for (const char* folder : kFolders) {
    const auto path = (program.parent_path() / folder / file).lexically_normal();
    folders += (folders.empty() ? "" : " or ") + path.parent_path().string();
    if (!std::filesystem::exists(path, error)) continue;
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
