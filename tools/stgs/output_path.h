// SPDX-License-Identifier: Apache-2.0
// What the verbs ask of a place before they write there, and how they leave none of their work.
#pragma once

#include <string>
#include <vector>

#include "stgs/format/output_file.h"
#include "stgs/format/output_path.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// The temporary folder that belongs to `path`, for this process.
std::string work_name(const std::string& path);
// Removes the folders that work_name gave to processes that have ended without removing them, on
// this machine, and returns their names. A folder that cannot be removed stays.
std::vector<std::string> remove_stale_work(const std::string& path);
// As check_can_write, for a new or existing folder.
Status check_can_make_folder(const std::string& path);
// Whether a path lies right in a folder that is not there yet.
bool lies_in_new(const std::string& path, const std::string& folder);

// A path that is removed, with all in it, when this goes, unless kept.
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
