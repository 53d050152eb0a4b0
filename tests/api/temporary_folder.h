// SPDX-License-Identifier: Apache-2.0
// A folder of a test's own, removed with it. Tests run side by side, those of one program too: none
// has a fixed name in the temporary folder.
#pragma once

#include <stdlib.h>

#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>

namespace stgs::testing {

struct TemporaryFolder {
  // Throws where none can be made.
  TemporaryFolder() : path((std::filesystem::temp_directory_path() / "stgs_test_XXXXXX").string()) {
    if (::mkdtemp(path.data()) == nullptr)
      throw std::system_error(errno, std::generic_category(), path);
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  std::string operator/(const std::string& name) const { return path + "/" + name; }

  std::string path;
};

}  // namespace stgs::testing
