// SPDX-License-Identifier: Apache-2.0
#include "foreign_content.h"

#include <algorithm>
#include <cctype>
#include <string_view>

namespace stgs {
namespace {

using Head = std::span<const std::uint8_t>;

struct Signature {
  std::size_t offset;
  std::string_view bytes;
  const char* text;
};

constexpr Signature kSignatures[] = {
    {0, "ply\n", "this is a PLY file; convert models with 'stgs convert'"},
    {0, "ply\r", "this is a PLY file; convert models with 'stgs convert'"},
    {0, "NGSP", "this is an SPZ model; convert it with 'stgs convert'"},
    {0, "\x1F\x8B", "this is a gzip file; convert SPZ models with 'stgs convert'"},
    {0, "PK\x03\x04", "this is a zip archive; convert SOG models with 'stgs convert'"},
    {1, "4DGS", "this is a .4dgs file; convert it with 'stgs convert'"},
    {0, "glTF", "this is a binary glTF file"},
    {0, "\x89PNG", "this is a PNG image"},
    {0, "\xFF\xD8\xFF", "this is a JPEG image"},
    {0, "GIF8", "this is a GIF image"},
    {0, "\x76\x2F\x31\x01", "this is an OpenEXR image"},
    {8, "WEBP", "this is a WebP image"},
    {4, "ftyp", "this is an MP4 video"},
    {0, "\x1A\x45\xDF\xA3", "this is a Matroska or WebM video"},
    {8, "AVI ", "this is an AVI video"},
    {0, "YUV4MPEG2", "this is a Y4M video"},
    {0, "STGSCKP", "this is a training checkpoint; continue it with 'stgs train --resume'"},
    {0, "%PDF", "this is a PDF document"},
};

bool matches(Head head, const Signature& signature) {
  const auto& [offset, bytes, text] = signature;
  return head.size() >= offset + bytes.size() &&
         std::equal(bytes.begin(), bytes.end(), head.begin() + static_cast<std::ptrdiff_t>(offset),
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
}

bool is_text(Head head) {
  return std::all_of(head.begin(), head.end(), [](std::uint8_t c) {
    return c >= 0x20 || c == '\t' || c == '\r' || c == '\n';
  });
}

std::string describe_text(Head head) {
  std::string text(head.begin(), head.end());
  if (text.rfind("\xEF\xBB\xBF", 0) == 0) text.erase(0, 3);  // byte order mark
  text.erase(0, text.find_first_not_of(" \t\r\n"));
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto starts = [&text](std::string_view with) { return text.rfind(with, 0) == 0; };
  if (starts("<!doctype html") || starts("<html")) {
    return "this is an HTML page; check the URL it was downloaded from";
  }
  if (starts("<")) return "this is an XML or HTML file";
  if (starts("version https://git-lfs")) return "this is a Git LFS pointer; run 'git lfs pull'";
  if (starts("{") || starts("[")) return "this is a JSON file";
  return "this is a text file";
}

}  // namespace

std::string describe_foreign_content(std::span<const std::uint8_t> head) {
  if (head.empty()) return {};
  for (const Signature& signature : kSignatures) {
    if (matches(head, signature)) return signature.text;
  }
  if (std::all_of(head.begin(), head.end(), [](std::uint8_t b) { return b == 0; })) {
    return "it begins with zeros; check whether a copy or download was interrupted";
  }
  return is_text(head) ? describe_text(head) : "";
}

}  // namespace stgs
