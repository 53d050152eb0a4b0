// SPDX-License-Identifier: Apache-2.0
#include "content_kind.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <string_view>

namespace stgs::tools {
namespace {

using Head = std::span<const std::uint8_t>;

constexpr const char* kConvert = "; use 'stgs convert'";
constexpr const char* kEncode = "; use 'stgs encode' on the folder of the videos";

struct Signature {
  std::size_t offset;
  std::string_view bytes;
  const char* kind;
  const char* advice;
};

// The first match wins.
constexpr Signature kSignatures[] = {
    {0, "\x89PNG\r\n\x1A\n", "a PNG image", ""},
    {0, "\xFF\xD8\xFF", "a JPEG image", ""},
    {0, "GIF8", "a GIF image", ""},
    {0, "\x76\x2F\x31\x01", "an OpenEXR image", ""},
    {8, "WEBP", "a WebP image", ""},
    {8, "AVI ", "an AVI video", kEncode},
    {4, "ftyp", "an MP4 video", kEncode},
    {0, "\x1A\x45\xDF\xA3", "a Matroska or WebM video", kEncode},
    {0, "YUV4MPEG2", "a Y4M video", kEncode},
    {0, "ply\n", "a PLY model", kConvert},
    {0, "ply\r", "a PLY model", kConvert},
    {0, "NGSP", "an SPZ model", kConvert},
    {0, "glTF", "a glTF model", ", which 'stgs convert' writes but does not read"},
    {0, "\x1F\x8B", "gzip data, for example an SPZ model", kConvert},
    {0, std::string_view("PK\x03\x04", 4), "a ZIP archive, for example a SOG bundle", kConvert},
    {0, "%PDF", "a PDF document", ""},
    {0,
     "\x7F"
     "ELF",
     "a program", ""},
    {0, "STGSCKP", "a training checkpoint", "; use 'stgs train --resume'"},
};

bool matches(Head head, std::size_t offset, std::string_view bytes) {
  return head.size() >= offset + bytes.size() &&
         std::equal(bytes.begin(), bytes.end(), head.begin() + static_cast<std::ptrdiff_t>(offset),
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
}

// Returns the text after white space and a byte order mark, in lower case.
std::string leading_text(Head head) {
  std::string text(head.begin(), head.end());
  if (text.rfind("\xEF\xBB\xBF", 0) == 0) text.erase(0, 3);
  text.erase(0, text.find_first_not_of(" \t\r\n"));
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

bool is_text(Head head) {
  return std::all_of(head.begin(), head.end(), [](std::uint8_t c) {
    return c >= 0x20 || c == '\t' || c == '\r' || c == '\n';
  });
}

std::string describe_text(Head head) {
  const std::string text = leading_text(head);
  const auto starts = [&text](std::string_view with) { return text.rfind(with, 0) == 0; };
  if (starts("<!doctype html") || starts("<html") || starts("<head") || starts("<body")) {
    return "this is an HTML page; check the URL, or whether the server requires a login";
  }
  if (starts("<?xml") || starts("<svg")) return "this is an XML file";
  if (starts("version https://git-lfs")) return "this is a Git LFS pointer; run 'git lfs pull'";
  if (starts("{") || starts("[")) return "this is a JSON file";
  return "this is a text file";
}

}  // namespace

std::string describe_content(std::span<const std::uint8_t> head) {
  if (head.empty()) return {};
  for (const Signature& signature : kSignatures) {
    if (!matches(head, signature.offset, signature.bytes)) continue;
    return fmt::format("this is {}{}", signature.kind, signature.advice);
  }
  if (std::all_of(head.begin(), head.end(), [](std::uint8_t b) { return b == 0; })) {
    return "this file begins with zeros; was a copy or download interrupted?";
  }
  return is_text(head) ? describe_text(head) : "";
}

}  // namespace stgs::tools
