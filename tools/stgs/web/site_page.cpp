// SPDX-License-Identifier: Apache-2.0
#include "site_page.h"

#include <libdeflate.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "session.h"
#include "site_files.h"
#include "stgs/format/escape.h"

namespace stgs::tools {
namespace {

constexpr std::string_view kTitle = "<title>STGS</title>";
constexpr std::string_view kPreload =
    "<link rel=\"preload\" href=\"./stgs-core.wasm\" as=\"fetch\" crossorigin>\n";
constexpr std::string_view kSettings =
    "<script type=\"application/json\" id=\"stgs-page\">{}</script>";
constexpr std::string_view kScript = "<script type=\"module\" src=\"./viewer.js\"></script>";
constexpr std::size_t kChunk = std::size_t{3} << 20;  // bytes of an element; divisible by 3
static_assert(kChunk % 3 == 0, "only the last chunk may end with padding");

// Replaces the only occurrence of `mark`, which is part of the template.
void replace_mark(std::string& page, std::string_view mark, const std::string& text) {
  page.replace(page.find(mark), mark.size(), text);
}

// Returns JSON in ASCII that ends no element of HTML.
std::string inline_json(const Json& json) {
  std::string out;
  for (const char c : json_text(json)) out += c == '<' ? std::string("\\u003c") : std::string(1, c);
  return out;
}

std::string base64(std::span<const std::uint8_t> bytes) {
  static constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out((bytes.size() + 2) / 3 * 4, '=');
  char* to = out.data();
  for (std::size_t i = 0; i < bytes.size(); i += 3, to += 4) {
    const std::size_t count = std::min<std::size_t>(bytes.size() - i, 3);
    std::uint32_t bits = static_cast<std::uint32_t>(bytes[i]) << 16;
    if (count > 1) bits |= static_cast<std::uint32_t>(bytes[i + 1]) << 8;
    if (count > 2) bits |= bytes[i + 2];
    for (std::size_t digit = 0; digit <= count; ++digit) {
      to[digit] = kDigits[bits >> (18 - 6 * digit) & 63];
    }
  }
  return out;
}

Result<std::vector<std::uint8_t>> gzip(std::string_view bytes) {
  constexpr int kLevel = 9;
  const std::unique_ptr<libdeflate_compressor, void (*)(libdeflate_compressor*)> compressor(
      libdeflate_alloc_compressor(kLevel), &libdeflate_free_compressor);
  if (compressor == nullptr) return Status(StatusCode::kNoMemory, "not enough memory");
  std::vector<std::uint8_t> out(libdeflate_gzip_compress_bound(compressor.get(), bytes.size()));
  out.resize(libdeflate_gzip_compress(compressor.get(), bytes.data(), bytes.size(), out.data(),
                                      out.size()));
  return out;
}

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

Status write_text(const WriteBytes& write, std::string_view text) {
  return write(bytes_of(text));
}

Status write_element(const WriteBytes& write, std::string_view attributes,
                     std::span<const std::uint8_t> bytes) {
  STGS_TRY(write_text(write, fmt::format("<script type=\"text/plain\" {}>", attributes)));
  STGS_TRY(write_text(write, base64(bytes)));
  return write_text(write, "</script>\n");
}

// Writes a file as elements with the same attributes.
Status write_elements(const WriteBytes& write, std::string_view attributes,
                      const ByteSource& file) {
  std::vector<std::uint8_t> bytes;
  for (std::uint64_t at = 0; at < file.size(); at += bytes.size()) {
    bytes.resize(std::min<std::uint64_t>(kChunk, file.size() - at));
    STGS_TRY(file.read(at, bytes));
    STGS_TRY(write_element(write, attributes, bytes));
  }
  return {};
}

}  // namespace

std::string site_page(const PageSettings& settings) {
  std::string page(kPageTemplate);
  // Pages without a scene may not need the core.
  if (settings.scene.empty()) replace_mark(page, kPreload, "");
  replace_mark(page, kTitle, fmt::format("<title>{}</title>", escape_html(settings.title)));
  Json json = Json::object();
  if (!settings.scene.empty()) json["scene"] = settings.scene;
  if (!settings.list.empty()) json["list"] = settings.list;
  if (!settings.bridge.empty()) json["bridge"] = settings.bridge;
  std::string element(kSettings);
  replace_mark(element, "{}", inline_json(json));
  replace_mark(page, kSettings, element);
  return page;
}

Status write_single_page(const PageSettings& settings, const SinglePageContent& content,
                         const WriteBytes& write) {
  const std::string page = site_page(settings);
  const std::size_t at = page.find(kScript);
  STGS_TRY(write_text(write, std::string_view(page).substr(0, at)));
  STGS_TRY(write_element(write, "id=\"stgs-worker\"", bytes_of(kSite[kWorkerScript].bytes)));
  STGS_TRY(write_element(write, "id=\"stgs-sorter\"", bytes_of(kSite[kSorterScript].bytes)));
  STGS_ASSIGN(const auto core, gzip(kSite[kCore].bytes));
  STGS_TRY(write_element(write, "id=\"stgs-core\"", core));
  STGS_TRY(write_elements(write, "class=\"stgs-scene\"", content.scene));
  if (content.audio != nullptr) {
    const std::string attributes =
        fmt::format("class=\"stgs-audio\" data-type=\"{}\"", content.audio_type);
    STGS_TRY(write_elements(write, attributes, *content.audio));
  }
  STGS_TRY(write_text(write, "<script type=\"module\">"));
  STGS_TRY(write_text(write, kSite[kViewerScript].bytes));
  STGS_TRY(write_text(write, "</script>\n"));
  return write_text(write, std::string_view(page).substr(at + kScript.size()));
}

}  // namespace stgs::tools
