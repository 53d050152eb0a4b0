// SPDX-License-Identifier: Apache-2.0
#include "config_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <sstream>
#include <string_view>

namespace stgs::tools {
namespace {

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r\v\f";
  const std::size_t begin = text.find_first_not_of(kBlank);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlank) + 1 - begin);
}

// Returns the name in a line "[name]", or nothing.
std::string_view section_of(std::string_view line) {
  const bool is_section = line.size() > 1 && line.front() == '[' && line.back() == ']';
  return is_section ? line.substr(1, line.size() - 2) : std::string_view();
}

// Returns the number of sections that the name in a line states: of a section, or of an option
// before its value.
std::ptrdiff_t depth_of(std::string_view line) {
  const std::string_view section = section_of(line);
  const std::string_view name =
      section.empty() ? line.substr(0, line.find_first_of("=,\"'[#")) : section;
  return std::count(name.begin(), name.end(), '.');
}

// Calls visit(line, number) for the trimmed lines of a text, numbered from 1, until it returns
// false.
template <typename Visit>
void for_each_line(std::string_view text, const Visit& visit) {
  for (int number = 1; !text.empty(); ++number) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    if (!visit(trimmed(text.substr(0, end)), number)) return;
    text.remove_prefix(std::min(end + 1, text.size()));
  }
}

// Returns why a file is rejected, or "".
std::string problem_of(std::string_view text) {
  if (text.size() > ConfigFile::kMaxBytes)
    return fmt::format(": more than {} bytes (expected options)", ConfigFile::kMaxBytes);
  std::string problem;
  for_each_line(text, [&](std::string_view line, int number) {
    if (line.size() > ConfigFile::kMaxLine) {
      problem = fmt::format(":{}: a line of {} bytes (expected at most {})", number, line.size(),
                            ConfigFile::kMaxLine);
    } else if (depth_of(line) > ConfigFile::kMaxDepth) {
      problem = fmt::format(":{}: a name within more than {} sections; write [VERB]", number,
                            ConfigFile::kMaxDepth);
    }
    return problem.empty();
  });
  return problem;
}

}  // namespace

std::vector<CLI::ConfigItem> ConfigFile::from_config(std::istream& input) const {
  text_.resize(kMaxBytes + 1);
  input.read(text_.data(), static_cast<std::streamsize>(text_.size()));
  text_.resize(static_cast<std::size_t>(input.gcount()));
  problem_ = problem_of(text_);
  if (!problem_.empty()) throw CLI::FileError(problem_);
  std::istringstream checked(text_);
  return CLI::ConfigTOML::from_config(checked);
}

int ConfigFile::line_of(const std::string& key) const {
  int found = 0;
  std::string section;
  for_each_line(text_, [&](std::string_view line, int number) {
    if (const std::string_view name = section_of(line); !name.empty()) {
      section = std::string(name) + ".";
    } else if (section + std::string(trimmed(line.substr(0, line.find('=')))) == key) {
      found = number;
    }
    return found == 0;
  });
  return found;
}

std::string check_config_file(const std::string& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status) || std::filesystem::is_regular_file(status)) return {};
  return fmt::format("--config: '{}' is not a regular file (expected a file with options)", path);
}

}  // namespace stgs::tools
