// SPDX-License-Identifier: Apache-2.0
// Options and reports for the import of animated formats.
#pragma once

#include <optional>
#include <string>

#include "arguments.h"
#include "session.h"
#include "stgs/format/interchange_formats.h"
#include "stgs/format/status.h"

namespace stgs::tools {

class ImportOptions {
 public:
  void declare(Arguments& app);
  // kUsage if an option is given that does not apply to `format` (null: .stgs).
  Status check(const std::string& path, const InterchangeFormat* format) const;
  ImportSettings settings() const;

 private:
  std::optional<double> fps_, tolerance_;
  std::optional<std::uint32_t> frames_;
};

// Names the formats that can be read in the error of a file that is not an .stgs file. Returns
// other errors as they are.
Status with_readable_formats(const Status& status);

// Returns the JSON fields "sequence", "splatv" and "curves"; null for other formats.
Json import_json(const ImportReport& report);
// Returns the same as lines of text; "" for other formats.
std::string import_text(const ImportReport& report);

}  // namespace stgs::tools
