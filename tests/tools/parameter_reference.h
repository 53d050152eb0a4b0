// SPDX-License-Identifier: Apache-2.0
// The page sdk/docs/parameters.md, made from the tables of parameters.
#pragma once

#include <string>

namespace stgs::testing {

std::string parameter_reference();

}  // namespace stgs::testing
