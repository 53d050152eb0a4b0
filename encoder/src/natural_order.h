// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace stgs::encoder {

// Natural order: runs of digits compare as numbers, so "cam9" precedes "cam10".
bool natural_less(const std::string& a, const std::string& b);

}  // namespace stgs::encoder
