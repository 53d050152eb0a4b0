// SPDX-License-Identifier: Apache-2.0
// Temporary paths that clean up after themselves.
#pragma once

#include <string>
#include <utility>

namespace stgs::tools {

// Removes a file or folder in its destructor, unless keep() was called.
class RemovedPath {
 public:
  explicit RemovedPath(std::string path) : path_(std::move(path)) {}
  ~RemovedPath();
  RemovedPath(const RemovedPath&) = delete;
  RemovedPath& operator=(const RemovedPath&) = delete;
  void keep() { path_.clear(); }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace stgs::tools
