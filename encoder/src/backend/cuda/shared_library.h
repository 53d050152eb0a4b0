// SPDX-License-Identifier: Apache-2.0
// A library that is opened at run time, so that the program starts where it is missing.
#pragma once

#include <string>
#include <type_traits>

#include "stgs/format/status.h"

namespace stgs::encoder::cuda {

// Stays loaded to the end of the process. Errors are kept for problem().
class SharedLibrary {
 public:
  explicit SharedLibrary(const char* name);

  // Sets the pointer to the library's function of that name.
  template <typename Function>
  void find(Function& function, const char* name) {
    function = reinterpret_cast<Function>(address_of(name));
  }
  // Why it cannot be used; "" where it can, and all functions were found.
  const std::string& problem() const { return problem_; }

 private:
  void* address_of(const char* name);

  const char* name_;
  void* library_;
  std::string problem_;
};

}  // namespace stgs::encoder::cuda
