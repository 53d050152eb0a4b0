// SPDX-License-Identifier: Apache-2.0
#include "packed_files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <filesystem>

namespace stgs::fuzz {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kSeparator = "\x1c=\x1c";
constexpr std::size_t kMaxFiles = 256, kMaxName = 512;

std::string_view text_of(View input) {
  return {reinterpret_cast<const char*>(input.data()), input.size()};
}

bool stays_inside(const std::string& name) {
  if (name.empty() || name.size() > kMaxName || name.find('\0') != std::string::npos) return false;
  const fs::path path = fs::path(name).lexically_normal();
  return path.is_relative() && *path.begin() != "..";
}

// Writes a file and closes it.
void write_all(int file, std::string_view content) {
  require(file >= 0 &&
              ::write(file, content.data(), content.size()) == static_cast<ssize_t>(content.size()),
          "the input can be written to a file");
  ::close(file);
}

}  // namespace

Bytes pack_files(const PackedFiles& packed) {
  std::string out = packed.options;
  for (const auto& [name, content] : packed.files) {
    out += std::string(kSeparator) + name + "\n" + content;
  }
  return {out.begin(), out.end()};
}

PackedFiles unpack_files(View input) {
  const std::string_view text = text_of(input);
  PackedFiles out;
  std::size_t at = text.find(kSeparator);
  out.options = text.substr(0, at);
  while (at != std::string_view::npos && out.files.size() < kMaxFiles) {
    const std::size_t begin = at + kSeparator.size();
    at = text.find(kSeparator, begin);
    const std::string_view file = text.substr(begin, at - begin);
    const std::size_t line = file.find('\n');
    PackedFile& unpacked = out.files.emplace_back();
    unpacked.name = file.substr(0, line);
    if (line != std::string_view::npos) unpacked.content = file.substr(line + 1);
  }
  return out;
}

std::vector<Unit> file_units(View input) {
  const std::string_view text = text_of(input);
  std::vector<Unit> out;
  for (std::size_t at = text.find(kSeparator); at < text.size();) {
    const std::size_t end = std::min(text.find(kSeparator, at + kSeparator.size()), text.size());
    const std::size_t content = std::min(text.find('\n', at) + 1, end);
    out.push_back({at, end});
    if (content < end) out.push_back({content, end});
    at = end;
  }
  return out;
}

InputFolder::InputFolder() : root_(testing::memory_folder()), path_(root_ / "input") {
  fs::create_directory(path_);
}

void InputFolder::write(const std::vector<PackedFile>& files) const {
  std::error_code failed;  // a name may be too long, or a file be in place of a folder
  fs::remove_all(path_, failed);
  fs::create_directory(path_, failed);
  const auto target_of = [&](const std::string& name) { return fs::path(path_) / name; };
  for (const auto& [name, content] : files) {
    if (!stays_inside(name) || name.back() == '@') continue;
    const bool is_pipe = name.back() == '|';
    const fs::path target = target_of(is_pipe ? name.substr(0, name.size() - 1) : name);
    fs::create_directories(target.parent_path(), failed);
    if (is_pipe) {
      (void)::mkfifo(target.c_str(), 0600);
    } else if (name.back() != '/') {
      const int file = ::open(target.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
      if (file < 0) continue;
      write_all(file, content);
    }
  }
  // Links last, because the parents of a file must not lead out of the folder.
  for (const auto& [name, content] : files) {
    if (!stays_inside(name) || name.back() != '@') continue;
    const fs::path target = target_of(name.substr(0, name.size() - 1));
    const fs::path parent = fs::canonical(target.parent_path(), failed);
    if (failed || parent.string().compare(0, path_.size(), path_) != 0) continue;
    fs::create_symlink(content, target, failed);
  }
}

const InputFolder& input_folder() {
  static const InputFolder folder;
  return folder;
}

std::string path_of_descriptor(int descriptor) {
  std::array<char, 4096> path;
  const ssize_t size =
      ::readlink(("/proc/self/fd/" + std::to_string(descriptor)).c_str(), path.data(), path.size());
  return {path.data(), size > 0 ? static_cast<std::size_t>(size) : 0};
}

void write_input(const std::string& path, std::string_view content) {
  write_all(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600), content);
}

std::string tiny_bmp(int width, int height, std::uint8_t value) {
  const int row = (3 * width + 3) / 4 * 4;
  const auto pixels = static_cast<std::uint32_t>(row * height);
  std::string out = "BM";
  append_value(out, std::uint32_t{54} + pixels);
  append_value(out, std::uint32_t{0});
  append_value(out, std::uint32_t{54});  // offset of the pixels
  append_value(out, std::uint32_t{40});  // size of the header that follows
  append_value(out, static_cast<std::int32_t>(width));
  append_value(out, static_cast<std::int32_t>(height));
  append_value(out, std::uint16_t{1});
  append_value(out, std::uint16_t{24});
  for (const std::uint32_t v : {0u, pixels, 2835u, 2835u, 0u, 0u}) append_value(out, v);
  out.append(pixels, static_cast<char>(value));
  return out;
}

}  // namespace stgs::fuzz
