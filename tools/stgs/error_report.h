// SPDX-License-Identifier: Apache-2.0
// Errors as JSON, for --format json.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "session.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// Returns the exit code of the program for a status.
int exit_code(StatusCode code);

// Returns {"error": {"code", "exit_code", "message", "path", "issue", "offset"}}; the last three
// are null where they do not apply. `arguments` are those of the command line: the path is the file
// that the message begins with, if it is one of them or lies in one.
Json error_json(const Status& status, const std::vector<std::string>& arguments);

// Returns an error with advice before the place of its message, as in "x.stgs: not an .stgs file;
// ADVICE (byte 0, issue 102)".
Status with_advice(const Status& status, const std::string& advice);
// Returns whether a message ends with the place of this issue.
bool has_issue(const Status& status, std::uint64_t issue);
// Names the option --memory in the error of a memory limit. Returns other errors as they are.
Status with_memory_option(const Status& status);

// Names the options --timeout and --allow-private in the message of a failed read from a URL.
// Returns other messages as they are.
std::string with_url_option(std::string message);

// Returns whether the arguments select --format json; for errors of the command line itself.
bool wants_json(const std::vector<std::string>& arguments);

}  // namespace stgs::tools
