// SPDX-License-Identifier: Apache-2.0
// The option --memory of the verbs that read complete files.
#pragma once

#include <string>

#include "arguments.h"
#include "options.h"
#include "stgs/format/scene_file.h"

namespace stgs::tools {

class MemoryOption {
 public:
  void declare(Arguments& app) {
    app.add_option("--memory", text_, "Memory for reading a file, for example 512M or 8G")
        ->check(accepted_by<parse_memory>)
        ->capture_default_str();
  }
  // Returns the bytes. The option has been parsed.
  std::uint64_t bytes() const { return parse_memory(text_).value(); }
  // Returns the limits of reading. The option has been parsed.
  ReadLimits limits() const { return ReadLimits::of(ReadLimits().max_primitives, bytes()); }

 private:
  std::string text_ = "4G";
};

}  // namespace stgs::tools
