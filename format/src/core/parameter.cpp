// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/parameter.h"

#include <algorithm>

namespace stgs {

std::string Parameter::option_name() const {
  if (option != nullptr) return option;
  std::string text = fmt::format("--{}", name);
  std::replace(text.begin(), text.end(), '_', '-');
  return text;
}

}  // namespace stgs
