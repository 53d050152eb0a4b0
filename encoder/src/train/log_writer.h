// SPDX-License-Identifier: Apache-2.0
// Writes the log that training_log.h describes.
#pragma once

#include <cstdint>
#include <string>

#include "stgs/encoder/training_log.h"
#include "stgs/format/output_file.h"

namespace stgs::encoder {

class LogWriter {
 public:
  // Starts a log at `path`. A run resumed at iteration `resumed` > 0 retains the lines up to it and
  // drops the rest, which it will write again. Devices and pipes are written as OutputFile does.
  Status open(const std::string& path, std::uint64_t resumed);

  void write(const LoggedStep& step);
  void write(const LoggedEvaluation& evaluation);
  // Returns kIo if a line could not be written. Those after it are not.
  const Status& check() const { return status_; }

 private:
  void write_line(const std::string& line);

  bool is_open_ = false;
  OutputFile file_;
  Status status_;
};

}  // namespace stgs::encoder
