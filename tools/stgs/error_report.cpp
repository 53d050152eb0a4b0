// SPDX-License-Identifier: Apache-2.0
#include "error_report.h"

#include <charconv>
#include <regex>

#include "location.h"

namespace stgs::tools {
namespace {

const char* code_name(StatusCode code) {
  switch (code) {
    case StatusCode::kOk:
      return "ok";
    case StatusCode::kUsage:
      return "usage";
    case StatusCode::kIo:
      return "io";
    case StatusCode::kInvalidFile:
      return "invalid_file";
    case StatusCode::kRuntime:
      return "runtime";
    case StatusCode::kUnsupported:
      return "unsupported";
    case StatusCode::kNotBuilt:
      return "not_built";
    case StatusCode::kDiffers:
      return "differs";
    case StatusCode::kNoMemory:
      return "out_of_memory";
    case StatusCode::kLimit:
      return "limit";
    case StatusCode::kDeviceLost:
      return "device_lost";
  }
  return "runtime";
}

// Returns the path before ": " at the beginning of a message, if it begins with the argument.
std::string leading_path(const std::string& message, const std::string& argument) {
  const std::string name = display_name(argument);
  if (name.empty() || message.rfind(name, 0) != 0) return {};
  const char next = message.size() > name.size() ? message[name.size()] : '\0';
  const bool is_inside = next == '/' || name.back() == '/';
  if (next != ':' && !is_inside) return {};
  const std::size_t end = message.find(": ", name.size());
  return end == std::string::npos ? std::string() : message.substr(0, end);
}

Json path_json(const std::string& message, const std::vector<std::string>& arguments) {
  std::string path;
  for (const std::string& argument : arguments) {
    const std::string found = leading_path(message, argument);
    if (found.size() > path.size()) path = found;
  }
  return path.empty() ? Json(nullptr) : Json(path);
}

Json number_json(const std::string& digits) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  return error == std::errc() ? Json(value) : Json(nullptr);
}

}  // namespace

int exit_code(StatusCode code) {
  switch (code) {
    case StatusCode::kNoMemory:
    case StatusCode::kDeviceLost:
      return static_cast<int>(StatusCode::kRuntime);
    case StatusCode::kLimit:
      return static_cast<int>(StatusCode::kUnsupported);
    default:
      return static_cast<int>(code);
  }
}

Json error_json(const Status& status, const std::vector<std::string>& arguments) {
  // "x.stgs: not an .stgs file (byte 0, issue 102)"
  static const std::regex place(R"(\(byte (\d+), issue (\d+)\))");
  const std::string& message = status.message();
  std::smatch found;
  const bool has_issue = std::regex_search(message, found, place);
  return {{"error",
           {{"code", code_name(status.code())},
            {"exit_code", exit_code(status.code())},
            {"message", message},
            {"path", path_json(message, arguments)},
            {"issue", has_issue ? number_json(found[2]) : Json(nullptr)},
            {"offset", has_issue ? number_json(found[1]) : Json(nullptr)}}}};
}

bool wants_json(const std::vector<std::string>& arguments) {
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    if (arguments[i] == "--format=json") return true;
    if (arguments[i] == "--format" && i + 1 < arguments.size() && arguments[i + 1] == "json") {
      return true;
    }
  }
  return false;
}

}  // namespace stgs::tools
