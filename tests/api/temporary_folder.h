// SPDX-License-Identifier: Apache-2.0
// A temporary folder with a unique name. Test programs, and cases of one program, run in parallel,
// so tests never use a fixed name in the system's temporary folder.
#pragma once

#include <stdlib.h>

#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>

namespace stgs::testing {

// Created by the constructor, removed with its contents by the destructor.
struct TemporaryFolder {
  // Throws std::system_error if the folder cannot be created.
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
