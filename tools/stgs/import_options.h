// SPDX-License-Identifier: Apache-2.0
// What a person says of formats that move, and what they are told of what was read.
#pragma once

#include <optional>
#include <string>

#include "session.h"
#include "stgs/format/interchange_formats.h"
#include "stgs/format/status.h"

namespace CLI {
class App;
}

namespace stgs::tools {

class ImportOptions {
 public:
  void declare(CLI::App& app);
  // kUsage where an option was given that `format` (null: .stgs) takes nothing from.
  Status check(const std::string& path, const InterchangeFormat* format) const;
  ImportSettings settings() const;

 private:
  std::optional<double> fps_, tolerance_;
  std::optional<std::uint32_t> frames_;
};

// The fields "sequence" and "splatv" of the JSON; null where the format is another one.
Json import_json(const ImportReport& report);
// The same for a person: lines, or nothing.
std::string import_text(const ImportReport& report);

}  // namespace stgs::tools
