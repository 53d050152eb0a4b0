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

// The number after `name` in a file of "name number" lines.
std::optional<std::uint64_t> field_of(const std::string& path, const std::string& name) {
  std::ifstream file(path);
  std::string word;
  while (file >> word) {
    std::uint64_t value = 0;
    if (word == name && file >> value) return value;
  }
  return {};
}

// The file's only number; none where it says "max".
std::optional<std::uint64_t> number_in(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::uint64_t value = 0;
  if (file >> value) return value;
  return {};
}

std::uint64_t machine_room() {
  if (const auto kib = field_of("/proc/meminfo", "MemAvailable:")) return *kib * 1024;
  return static_cast<std::uint64_t>(sysconf(_SC_PHYS_PAGES)) *
         static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE)) / 2;
}

// Of the control group that the process is in (cgroup v2).
std::uint64_t own_group_room() {
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
  std::uint64_t room = kNoLimit;
  for (;; group = group.parent_path()) {
    const std::filesystem::path folder = root / group;
    const auto most = number_in(folder / "memory.max");
    const auto held = number_in(folder / "memory.current");
    if (most && held) {
      const std::string statistics = (folder / "memory.stat").string();
      const std::uint64_t files = field_of(statistics, "file").value_or(0);
      const std::uint64_t shared = field_of(statistics, "shmem").value_or(0);
      const std::uint64_t used = *held - std::min(*held, files - std::min(files, shared));
      room = std::min(room, *most - std::min(*most, used));
    }
    if (group.empty()) return room;
  }
}

std::uint64_t available_memory() {
  return std::min(machine_room(), own_group_room());
}

}  // namespace stgs::encoder
