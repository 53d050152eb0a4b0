// SPDX-License-Identifier: Apache-2.0
// What the verbs ask of a place before they write there, and how they leave none of their work.
#pragma once

#include <string>
#include <vector>

#include "stgs/format/output_file.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// The temporary folder that belongs to `path`, for this process.
std::string work_name(const std::string& path);
// Removes the folders that work_name gave to processes that have ended without removing them, on
// this machine, and returns their names. A folder that cannot be removed stays.
std::vector<std::string> remove_stale_work(const std::string& path);
// The same for the files that temporary_name(path) gave.
std::vector<std::string> remove_stale_files(const std::string& path);

// Whether a file can be made at `path`: its folder exists and takes files, and nothing but a
// regular file is in the way. Asked before long work, so that hours are not lost at the end.
Status check_can_write(const std::string& path);
// The same for a new or existing folder.
Status check_can_make_folder(const std::string& path);

// A path that an option gives, or that follows from one; both for messages.
struct NamedPlace {
  std::string option, path;
};
// kUsage where two of them are one file or folder, whatever links and dots are in the way. Those
// with an empty path do not count.
Status check_distinct(const std::vector<NamedPlace>& places);

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
