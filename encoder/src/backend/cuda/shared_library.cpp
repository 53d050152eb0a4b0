// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/shared_library.h"

#include <dlfcn.h>

namespace stgs::encoder::cuda {

SharedLibrary::SharedLibrary(const char* name)
    : name_(name), library_(dlopen(name, RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE)) {
  if (library_ != nullptr) return;
  const char* text = dlerror();
  problem_ = text != nullptr ? text : fmt::format("{} could not be loaded", name);
}

void* SharedLibrary::address_of(const char* name) {
  void* address = library_ != nullptr ? dlsym(library_, name) : nullptr;
  if (address == nullptr && problem_.empty()) problem_ = fmt::format("{} has no {}", name_, name);
  return address;
}

}  // namespace stgs::encoder::cuda
