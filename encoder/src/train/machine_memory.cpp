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

// What the process's control group and those around it leave (cgroup v2); cached files count as
// free, for the kernel gives them up first.
std::uint64_t group_room() {
  std::ifstream file("/proc/self/cgroup");
  std::string line;
  std::uint64_t room = ~std::uint64_t{0};
  while (std::getline(file, line)) {
    if (line.rfind("0::/", 0) != 0) continue;
    const std::filesystem::path root = "/sys/fs/cgroup";
    for (std::filesystem::path group = line.substr(4);; group = group.parent_path()) {
      const std::filesystem::path folder = root / group;
      const auto most = number_in(folder / "memory.max");
      const auto held = number_in(folder / "memory.current");
      if (most && held) {
        const std::uint64_t files = field_of((folder / "memory.stat").string(), "file").value_or(0);
        const std::uint64_t used = *held - std::min(*held, files);
        room = std::min(room, *most - std::min(*most, used));
      }
      if (group.empty()) break;
    }
  }
  return room;
}

}  // namespace

std::uint64_t available_memory() {
  return std::min(machine_room(), group_room());
}

}  // namespace stgs::encoder
