// SPDX-License-Identifier: Apache-2.0
#include "png_text.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <span>
#include <string_view>

namespace stgs::encoder {
namespace {

using std::string_view_literals::operator""sv;

using Bytes = std::span<const std::uint8_t>;

constexpr std::array kSignatures = {"\x89PNG\r\n\x1a\n"sv, "\x8aMNG\r\n\x1a\n"sv};
constexpr std::size_t kSignatureBytes = 8, kMaxText = 64 << 10;
constexpr std::array kTexts = {"tEXt"sv, "zTXt"sv, "iTXt"sv, "iCCP"sv};

std::string_view text_of(Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

bool has_signature(Bytes bytes) {
  return std::any_of(kSignatures.begin(), kSignatures.end(),
                     [&](std::string_view s) { return text_of(bytes).starts_with(s); });
}

// Returns the bytes of the chunk with which `bytes` begin, at most all of them.
std::size_t chunk_bytes(Bytes bytes) {
  std::uint64_t size = 12;  // of its size, its kind and its checksum
  for (std::size_t i = 0; i < 4; ++i) size += std::uint64_t{bytes[i]} << (24 - 8 * i);
  return static_cast<std::size_t>(std::min<std::uint64_t>(size, bytes.size()));
}

// Calls visit(chunk, is_text) for each chunk after the signature, the last of which may be cut off.
template <typename Visit>
void visit_chunks(Bytes bytes, const Visit& visit) {
  for (bytes = bytes.subspan(kSignatureBytes); !bytes.empty();) {
    const std::size_t size = bytes.size() < 8 ? bytes.size() : chunk_bytes(bytes);
    const std::string_view kind =
        text_of(bytes.first(size)).substr(std::min<std::size_t>(size, 4), 4);
    visit(bytes.first(size), std::find(kTexts.begin(), kTexts.end(), kind) != kTexts.end());
    bytes = bytes.subspan(size);
  }
}

}  // namespace

void remove_png_text(std::vector<std::uint8_t>& bytes) {
  if (!has_signature(bytes)) return;
  std::size_t kept = kSignatureBytes;
  visit_chunks(bytes, [&](Bytes chunk, bool is_text) {
    if (is_text) return;
    std::memmove(bytes.data() + kept, chunk.data(), chunk.size());
    kept += chunk.size();
  });
  bytes.resize(kept);
}

bool has_long_png_text(std::span<const std::uint8_t> frame) {
  if (!has_signature(frame)) return false;
  std::size_t text = 0;
  visit_chunks(frame, [&](Bytes chunk, bool is_text) { text += is_text ? chunk.size() : 0; });
  return text > kMaxText;
}

}  // namespace stgs::encoder
