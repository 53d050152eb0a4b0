// SPDX-License-Identifier: Apache-2.0
#include "png_file.h"

#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <string_view>

namespace stgs::fuzz {
namespace {

constexpr std::string_view kSignature("\x89PNG\r\n\x1a\n", 8);
constexpr std::string_view kTypes[] = {"IHDR", "PLTE", "tRNS", "IDAT", "IEND"};
constexpr std::size_t kChunk = 12;  // length, type and checksum

void append_big(std::string& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out += static_cast<char>(value >> shift & 255u);
}

std::uint32_t get_big(View bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = at; i < at + 4; ++i) value = value << 8 | bytes[i];
  return value;
}

void put_big(Bytes& bytes, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i)
    bytes[at + i] = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}

std::uint32_t checksum(View bytes) {
  return static_cast<std::uint32_t>(crc32(0, bytes.data(), static_cast<uInt>(bytes.size())));
}

void append_chunk(std::string& out, std::string_view type, const std::string& content) {
  append_big(out, static_cast<std::uint32_t>(content.size()));
  const std::size_t at = out.size();
  out += std::string(type) + content;
  append_big(out,
             checksum({reinterpret_cast<const std::uint8_t*>(out.data()) + at, out.size() - at}));
}

bool is_png(View file) {
  return file.size() >= kSignature.size() &&
         std::memcmp(file.data(), kSignature.data(), kSignature.size()) == 0;
}

// Returns the offsets of chunks: where a known type is.
std::vector<std::size_t> chunks_by_type(View file) {
  std::vector<std::size_t> out;
  for (std::size_t at = kSignature.size(); at + kChunk <= file.size(); ++at) {
    const bool known =
        std::any_of(std::begin(kTypes), std::end(kTypes), [&](std::string_view type) {
          return std::memcmp(&file[at + 4], type.data(), type.size()) == 0;
        });
    if (known) out.push_back(at);
  }
  return out;
}

}  // namespace

std::string tiny_png(int width, int height, int channels) {
  std::string header;
  append_big(header, static_cast<std::uint32_t>(width));
  append_big(header, static_cast<std::uint32_t>(height));
  header += std::string("\x8\0\0\0\0", 5);
  header[9] = channels == 3 ? 2 : 0;
  std::string rows;
  for (int y = 0; y < height; ++y) {
    rows += static_cast<char>(y % 5);  // the filter
    for (int x = 0; x < width * channels; ++x) rows += static_cast<char>(x * 16 + y);
  }
  std::string stream = "\x78\x01\x01";  // one stored block
  const auto size = static_cast<unsigned>(rows.size());
  for (const unsigned part : {size & 255u, size >> 8u, ~size & 255u, (~size >> 8u) & 255u}) {
    stream += static_cast<char>(part);
  }
  stream += rows;
  append_big(stream,
             static_cast<std::uint32_t>(adler32(1, reinterpret_cast<const Bytef*>(rows.data()),
                                                static_cast<uInt>(rows.size()))));
  std::string out(kSignature);
  append_chunk(out, "IHDR", header);
  append_chunk(out, "IDAT", stream);
  append_chunk(out, "IEND", "");
  return out;
}

std::vector<Unit> png_units(View file) {
  std::vector<Unit> out;
  if (!is_png(file)) return out;
  for (const std::size_t at : chunks_by_type(file)) {
    const std::size_t length = get_big(file, at);
    out.push_back({at, at + kChunk + std::min(length, file.size() - at - kChunk)});
  }
  return out;
}

Bytes repair_png(Bytes file, Repair repair) {
  if (repair == Repair::kNothing || !is_png(file)) return file;
  const std::vector<std::size_t> chunks = chunks_by_type(file);
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    const std::size_t at = chunks[i];
    const std::size_t end = i + 1 < chunks.size() ? chunks[i + 1] : file.size();
    if (end < at + kChunk) continue;
    if (repair == Repair::kSizes) put_big(file, at, static_cast<std::uint32_t>(end - at - kChunk));
    const std::size_t length = get_big(file, at);
    if (length > file.size() - at - kChunk) continue;
    put_big(file, at + 8 + length, checksum(View(file).subspan(at + 4, 4 + length)));
  }
  return file;
}

}  // namespace stgs::fuzz
