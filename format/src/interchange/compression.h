// SPDX-License-Identifier: Apache-2.0
// Decoders of compressed bytes, with zlib and libzstd; for WebAssembly, which has no libraries, in
// sdk/web/core/unpack.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "stgs/format/status.h"

namespace stgs {

// Decodes a gzip stream incrementally. Bytes behind it are ignored.
class GzipReader {
 public:
  // The bytes must outlive the object. `file` is for messages.
  GzipReader(std::span<const std::uint8_t> bytes, std::string file);
  ~GzipReader();
  GzipReader(const GzipReader&) = delete;
  GzipReader& operator=(const GzipReader&) = delete;

  // Fills `out`, or less at the end of the stream. Returns the number of bytes. Verifies the
  // checksum at the end.
  Result<std::size_t> read_some(std::span<std::uint8_t> out);
  // Fills `out`.
  Status read(std::span<std::uint8_t> out);

 private:
  struct Stream;
  std::string file_;
  std::unique_ptr<Stream> stream_;
};

// Decodes zstd frames that hold exactly `out`. `label`: the frames, for messages.
Status decompress_zstd(std::span<const std::uint8_t> frames, std::span<std::uint8_t> out,
                       const std::string& label);

}  // namespace stgs
