// SPDX-License-Identifier: Apache-2.0
#include "train/machine_memory.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>

namespace stgs::encoder {
namespace {

constexpr std::uint64_t kNoLimit = ~std::uint64_t{0};

// Returns the number after `name` in a file of "name number" lines.
std::optional<std::uint64_t> field_of(const std::string& path, const std::string& name) {
  std::ifstream file(path);
  std::string word;
  while (file >> word) {
    std::uint64_t value = 0;
    if (word == name && file >> value) return value;
  }
  return {};
}

// Returns the file's only number; nullopt if it contains "max".
std::optional<std::uint64_t> number_in(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::uint64_t value = 0;
  if (file >> value) return value;
  return {};
}

std::uint64_t system_available() {
  if (const auto kib = field_of("/proc/meminfo", "MemAvailable:")) return *kib * 1024;
  return static_cast<std::uint64_t>(sysconf(_SC_PHYS_PAGES)) *
         static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE)) / 2;
}

// Of the control group of this process (cgroup v2).
std::uint64_t own_cgroup_available() {
  std::ifstream file("/proc/self/cgroup");
  std::string line;
  while (std::getline(file, line)) {
    if (line.rfind("0::/", 0) == 0)
      return cgroup_available_memory("/sys/fs/cgroup", line.substr(4));
  }
  return kNoLimit;
}

}  // namespace

std::uint64_t cgroup_available_memory(const std::filesystem::path& root,
                                      std::filesystem::path group) {
  std::uint64_t available = kNoLimit;
  for (;; group = group.parent_path()) {
    const std::filesystem::path folder = root / group;
    const auto limit = number_in(folder / "memory.max");
    const auto current = number_in(folder / "memory.current");
    if (limit && current) {
      const std::string statistics = (folder / "memory.stat").string();
      const std::uint64_t files = field_of(statistics, "file").value_or(0);
      const std::uint64_t shared = field_of(statistics, "shmem").value_or(0);
      const std::uint64_t used = *current - std::min(*current, files - std::min(files, shared));
      available = std::min(available, *limit - std::min(*limit, used));
    }
    if (group.empty()) return available;
  }
}

std::uint64_t available_memory() {
  return std::min(system_available(), own_cgroup_available());
}

}  // namespace stgs::encoder
