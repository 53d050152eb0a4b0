// SPDX-License-Identifier: Apache-2.0
#include "play/screenshot_saver.h"

#include <filesystem>
#include <system_error>
#include <utility>

namespace stgs::tools {
namespace {

// Returns the first of stgs-001.png, stgs-002.png, ... that does not exist.
std::string unused_name() {
  for (int i = 1;; ++i) {
    std::string name = fmt::format("stgs-{:03}.png", i);
    std::error_code error;
    if (!std::filesystem::exists(name, error)) return name;
  }
}

}  // namespace

ScreenshotSaver::~ScreenshotSaver() {
  if (saving_.valid()) saving_.wait();
}

void ScreenshotSaver::save(encoder::Image8 image) {
  saving_ = std::async(std::launch::async, [image = std::move(image)]() -> Result<std::string> {
    std::string name = unused_name();
    STGS_TRY(write_png(name, image));
    return name;
  });
}

void ScreenshotSaver::report(bool wait) {
  if (!saving_.valid()) return;
  if (!wait && saving_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
  const Result<std::string> name = saving_.get();
  if (name.ok()) {
    session_.log(2, "screenshot: " + *name);
  } else {
    session_.log(1, "no screenshot: " + name.status().message());
  }
}

}  // namespace stgs::tools
