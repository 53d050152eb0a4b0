// SPDX-License-Identifier: Apache-2.0
// Decoders of compressed bytes, with zlib and libzstd. In browsers, the browser decodes gzip
// (sdk/web/core/import_compression.cpp).
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "stgs/format/status.h"

namespace stgs {

// Greatest expansion of DEFLATE: a match of 258 bytes takes at least two bits.
inline constexpr std::uint64_t kDeflateRatio = 1032;
// That of zstd: a block of 128 KiB takes at least 4 bytes.
inline constexpr std::uint64_t kZstdRatio = 128 * 1024 / 4;

// Returns whether bytes begin as a gzip stream does.
inline bool is_gzip(std::span<const std::uint8_t> bytes) {
  return bytes.size() >= 2 && bytes[0] == 0x1F && bytes[1] == 0x8B;
}

// Decodes a gzip stream incrementally. Bytes after the stream are ignored.
class GzipReader {
 public:
  // The bytes must outlive the object. `file` is for messages.
  GzipReader(std::span<const std::uint8_t> bytes, std::string file);
  ~GzipReader();
  GzipReader(const GzipReader&) = delete;
  GzipReader& operator=(const GzipReader&) = delete;

  // Fills `out`, or part of it at the end of the stream. Returns the number of bytes. Verifies the
  // checksum at the end.
  Result<std::size_t> read_some(std::span<std::uint8_t> out);
  // Fills `out`.
  Status read(std::span<std::uint8_t> out) {
    STGS_ASSIGN(const std::size_t got, read_some(out));
    if (got == out.size()) return {};
    return invalid_file("{}: gzip stream is too short by {} bytes", file_, out.size() - got);
  }

 private:
  struct Stream;
  std::string file_;
  std::unique_ptr<Stream> stream_;
};

// Decodes zstd frames into `out`, whose size they must match. `label` names them in messages.
Status decompress_zstd(std::span<const std::uint8_t> frames, std::span<std::uint8_t> out,
                       const std::string& label);

}  // namespace stgs
