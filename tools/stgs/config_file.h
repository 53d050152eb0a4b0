// SPDX-License-Identifier: Apache-2.0
// The file of --config, which is read once and checked before CLI11 parses it.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace stgs::tools {

// A CLI11 reader of TOML files of a limited size: the time of CLI11 grows with the square of the
// depth of a section, and options have a few hundred bytes.
//
// CLI11 opens the file itself, and would wait for the writer of a pipe: give check_config_file() to
// its option.
class ConfigFile final : public CLI::ConfigTOML {
 public:
  static constexpr std::size_t kMaxBytes = 64 << 10, kMaxLine = 16 << 10;
  static constexpr int kMaxDepth = 8;  // dots in a name

  // Returns the options of a file. Throws CLI::FileError if problem() is set.
  std::vector<CLI::ConfigItem> from_config(std::istream& input) const override;

  // Why the last file was rejected, with its line, for example ":3: ..."; "": it was not.
  const std::string& problem() const { return problem_; }
  // Returns the line of the last file that sets `key`, for example "render.size", from 1; 0: none
  // does.
  int line_of(const std::string& key) const;

 private:
  mutable std::string text_, problem_;
};

// Returns why a path cannot be a file of options, or "". A file that does not exist is an error of
// CLI11.
std::string check_config_file(const std::string& path);

}  // namespace stgs::tools
