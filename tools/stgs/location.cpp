// SPDX-License-Identifier: Apache-2.0
#include "location.h"

#include "standard_streams.h"
#include "stgs/player/source.h"

namespace stgs::tools {

std::string display_name(const std::string& location) {
  return is_standard_input(location) ? "standard input" : player::display_location(location);
}

bool is_url(const std::string& location) {
  return player::is_url(location);
}

Status check_is_path(const std::string& location) {
  if (is_standard_input(location)) {
    return usage_error("this verb cannot read standard input; write the data to a file first");
  }
  if (!is_url(location)) return {};
  return usage_error("{}: this verb reads local files only; download the file first",
                     display_name(location));
}

}  // namespace stgs::tools
