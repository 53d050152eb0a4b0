// SPDX-License-Identifier: Apache-2.0
// Writes the log that training_log.h describes.
#pragma once

#include <cstdint>
#include <fstream>
#include <string>

#include "stgs/encoder/training_log.h"

namespace stgs::encoder {

class LogWriter {
 public:
  // Starts a log at `path`. A run resumed at iteration `resumed` > 0 retains the lines up to it and
  // drops the rest, which it will write again.
  Status open(const std::string& path, std::uint64_t resumed);

  bool is_open() const { return file_.is_open(); }
  void write(const LoggedStep& step);
  void write(const LoggedEvaluation& evaluation);
  // Returns kIo if a line could not be written.
  Status check() const;

 private:
  std::string path_;
  std::ofstream file_;
};

}  // namespace stgs::encoder
