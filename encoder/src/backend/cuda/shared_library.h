// SPDX-License-Identifier: Apache-2.0
// A library loaded at run time, so that the program starts without it.
#pragma once

#include <string>
#include <type_traits>

#include "stgs/format/status.h"

namespace stgs::encoder::cuda {

// The library remains loaded until the process ends. problem() returns the first error.
class SharedLibrary {
 public:
  explicit SharedLibrary(const char* name);

  // Sets `function` to the library's function of that name, or null.
  template <typename Function>
  void find(Function& function, const char* name) {
    function = reinterpret_cast<Function>(address_of(name));
  }
  // Returns why the library cannot be used; "" if it was loaded and all functions were found.
  const std::string& problem() const { return problem_; }

 private:
  void* address_of(const char* name);

  const char* name_;
  void* library_;
  std::string problem_;
};

}  // namespace stgs::encoder::cuda
