// SPDX-License-Identifier: Apache-2.0
#include "os/folder.h"

#include <dirent.h>

#include <algorithm>
#include <cerrno>
#include <memory>
#include <string_view>

#include "stgs/format/text.h"

namespace stgs::os {

Result<std::vector<std::string>> list_folder(const std::string& folder) {
  struct Close {
    void operator()(DIR* entries) const { ::closedir(entries); }
  };
  const std::unique_ptr<DIR, Close> entries(::opendir(folder.c_str()));
  if (entries == nullptr) {
    return io_error("{}: cannot list the folder: {}", folder, file_problem(errno));
  }
  std::vector<std::string> names;
  errno = 0;
  while (const dirent* entry = ::readdir(entries.get())) {
    const std::string_view name = entry->d_name;
    if (name != "." && name != "..") names.emplace_back(name);
    errno = 0;
  }
  if (errno != 0) return io_error("{}: cannot list the folder: {}", folder, system_message(errno));
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace stgs::os
