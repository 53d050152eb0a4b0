// SPDX-License-Identifier: Apache-2.0
// Names and kinds of the FILE argument of a verb: a path, an http or https URL, or "-" for standard
// input.
#pragma once

#include <string>

#include "stgs/format/status.h"

namespace stgs::tools {

// Returns the name of a location for messages: the path, the URL without userinfo, or "standard
// input".
std::string display_name(const std::string& location);
// Returns whether a location is an http or https URL.
bool is_url(const std::string& location);
// Returns kUsage if `location` is a URL or standard input, for verbs that read local files only.
Status check_is_path(const std::string& location);

}  // namespace stgs::tools
