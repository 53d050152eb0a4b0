// SPDX-License-Identifier: Apache-2.0
#include "error_report.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <string_view>

#include "location.h"
#include "printable.h"

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
  return path.empty() ? Json(nullptr) : Json(without_secrets(path, arguments));
}

// Where a file is damaged, and how.
struct Place {
  std::uint64_t offset = 0, issue = 0;
};

// Reads a number and the text after it from the beginning of `text`, and removes them.
bool take_number(std::string_view& text, std::string_view after, std::uint64_t& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc()) return false;
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  if (text.substr(0, after.size()) != after) return false;
  text.remove_prefix(after.size());
  return true;
}

// Returns the place in "x.stgs: not an .stgs file (byte 0, issue 102)"; nothing without one.
std::optional<Place> place_in(std::string_view message) {
  constexpr std::string_view kBegin = "(byte ";
  for (auto at = message.find(kBegin); at != std::string_view::npos; at = message.find(kBegin)) {
    message.remove_prefix(at + kBegin.size());
    Place place;
    if (take_number(message, ", issue ", place.offset) && take_number(message, ")", place.issue)) {
      return place;
    }
  }
  return std::nullopt;
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
  const std::string message = without_secrets(status.message(), arguments);
  const std::optional<Place> place = place_in(message);
  return {{"error",
           {{"code", code_name(status.code())},
            {"exit_code", exit_code(status.code())},
            {"message", message},
            {"path", path_json(status.message(), arguments)},
            {"issue", place ? Json(place->issue) : Json(nullptr)},
            {"offset", place ? Json(place->offset) : Json(nullptr)}}}};
}

Status with_advice(const Status& status, const std::string& advice) {
  std::string message = status.message();
  const std::size_t place = place_in(message) ? message.rfind(" (byte ") : std::string::npos;
  message.insert(std::min(place, message.size()), "; " + advice);
  return {status.code(), std::move(message)};
}

bool has_issue(const Status& status, std::uint64_t issue) {
  const std::optional<Place> place = place_in(status.message());
  return place && place->issue == issue;
}

Status with_memory_option(const Status& status) {
  constexpr std::uint64_t kMemoryLimit = 308;  // spec/conformance.md, 2
  constexpr const char* kAdvice = "use a larger --memory";
  // The advice of the libraries, to programs.
  for (const std::string_view advice : {"allow more memory", "raise memory_budget"}) {
    std::string message = status.message();
    const std::size_t at = message.find(advice);
    if (at == std::string::npos) continue;
    return {status.code(), message.replace(at, advice.size(), kAdvice)};
  }
  // The same number reports records that overlap, or too many of them: more memory does not help.
  const bool helps = status.message().find("memory") != std::string::npos;
  return helps && has_issue(status, kMemoryLimit) ? with_advice(status, kAdvice) : status;
}

std::string with_url_option(std::string message) {
  // The advice of the library, to programs.
  constexpr std::pair<std::string_view, std::string_view> kAdvice[] = {
      {"raise url_timeout_seconds", "use a larger --timeout"},
      {"set url_allow_private", "use --allow-private"}};
  for (const auto& [of_library, of_program] : kAdvice) {
    const std::size_t at = message.rfind(of_library);
    if (at != std::string::npos) message.replace(at, of_library.size(), of_program);
  }
  return message;
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
