// SPDX-License-Identifier: Apache-2.0
// Saves screenshots in the background.
#pragma once

#include <future>
#include <string>

#include "image_io.h"
#include "session.h"

namespace stgs::tools {

// Not thread-safe. The destructor waits for a screenshot that is being written.
class ScreenshotSaver {
 public:
  explicit ScreenshotSaver(Session& session) : session_(session) {}
  ~ScreenshotSaver();
  ScreenshotSaver(const ScreenshotSaver&) = delete;
  ScreenshotSaver& operator=(const ScreenshotSaver&) = delete;

  // Returns whether a screenshot is being written.
  bool is_saving() const { return saving_.valid(); }
  // Writes stgs-001.png, or the next number that is free. None may be in progress.
  void save(encoder::Image8 image);
  // Logs the name of a screenshot once it is written; with `wait`, blocks until then.
  void report(bool wait);

 private:
  Session& session_;
  std::future<Result<std::string>> saving_;
};

}  // namespace stgs::tools
