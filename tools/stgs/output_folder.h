// SPDX-License-Identifier: Apache-2.0
// Several files that appear in a folder once all are complete.
#pragma once

#include <string>
#include <vector>

#include "stgs/encoder/progress.h"
#include "stgs/format/temporary.h"

namespace stgs::tools {

// Collects files in a work folder. The destructor deletes those that were not committed. One thread
// at a time.
class OutputFolder {
 public:
  // Files for `folder`, which may exist and have other files. The run must have claimed it
  // (Session::claim_folder()). What killed runs left is removed and reported to `log`.
  OutputFolder(const std::string& folder, encoder::LogSink log);

  // Returns the path at which to write the file `name`: a file name, or a path below the folder.
  Result<std::string> add(const std::string& name);
  // Forgets a file of add(), which may not exist, and deletes it.
  void drop(const std::string& name);
  // Moves the files into the folder, in the order of add(), and replaces those of the same name.
  // Ignores SIGINT and SIGTERM meanwhile; kRuntime if one has arrived before. kIoError, with the
  // files that were moved, if a move fails, as for a subfolder that is a link.
  Status commit();

 private:
  Status create_work();
  Status move(int folder, const std::string& name) const;
  Status move_all() const;

  std::string folder_;  // without a slash at the end
  encoder::LogSink log_;
  WorkFolder work_;
  std::string made_;  // in the work folder; "" before the first file
  std::vector<std::string> names_;
};

}  // namespace stgs::tools
