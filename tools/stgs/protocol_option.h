// SPDX-License-Identifier: Apache-2.0
// The option --protocol of the verbs that prepare and measure.
#pragma once

#include <string>
#include <vector>

#include "arguments.h"
#include "options.h"
#include "stgs/encoder/protocol.h"
#include "usage.h"

namespace stgs::tools {

// Declares the option, whose value is the name of a protocol.
inline Argument* add_protocol(Arguments& app, std::string& name, const std::string& help) {
  std::vector<std::string> names;
  for (const encoder::Protocol& protocol : encoder::kProtocols) names.emplace_back(protocol.name);
  return with_choices(app.add_option("--protocol", name, help), names);
}

}  // namespace stgs::tools
