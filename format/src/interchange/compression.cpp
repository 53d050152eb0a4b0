// SPDX-License-Identifier: Apache-2.0
#include "interchange/compression.h"

#include <zlib.h>
#include <zstd.h>
#include <zstd_errors.h>

#include <algorithm>
#include <new>

namespace stgs {

struct GzipReader::Stream {
  z_stream zlib{};
  std::span<const std::uint8_t> bytes;
  std::size_t fed = 0;
  bool is_open = false, has_ended = false;
};

GzipReader::GzipReader(std::span<const std::uint8_t> bytes, std::string file)
    : file_(std::move(file)), stream_(std::make_unique<Stream>()) {
  stream_->bytes = bytes;
  stream_->zlib.next_in = const_cast<Bytef*>(bytes.data());  // zlib does not modify it
  stream_->is_open = inflateInit2(&stream_->zlib, 16 + MAX_WBITS) == Z_OK;
}

GzipReader::~GzipReader() {
  if (stream_->is_open) inflateEnd(&stream_->zlib);
}

Result<std::size_t> GzipReader::read_some(std::span<std::uint8_t> out) {
  Stream& stream = *stream_;
  if (!stream.is_open) return runtime_error("{}: zlib failed to initialise", file_);
  std::size_t done = 0;
  while (done < out.size() && !stream.has_ended) {
    // zlib counts bytes in 32 bits.
    const std::size_t in = std::min<std::size_t>(stream.bytes.size() - stream.fed, 1u << 30);
    const std::size_t space = std::min<std::size_t>(out.size() - done, 1u << 30);
    stream.zlib.avail_in = static_cast<uInt>(in);
    stream.zlib.next_out = out.data() + done;
    stream.zlib.avail_out = static_cast<uInt>(space);
    const int code = inflate(&stream.zlib, Z_NO_FLUSH);
    stream.fed += in - stream.zlib.avail_in;
    done += space - stream.zlib.avail_out;
    stream.has_ended = code == Z_STREAM_END;
    if (code == Z_MEM_ERROR) throw std::bad_alloc();
    if (code != Z_OK && !stream.has_ended) {
      return invalid_file("{}: gzip stream is damaged or truncated (byte {})", file_, stream.fed);
    }
  }
  return done;
}

Status decompress_zstd(std::span<const std::uint8_t> frames, std::span<std::uint8_t> out,
                       const std::string& label) {
  const std::size_t got = ZSTD_decompress(out.data(), out.size(), frames.data(), frames.size());
  if (!ZSTD_isError(got) && got == out.size()) return {};
  if (ZSTD_getErrorCode(got) == ZSTD_error_memory_allocation) throw std::bad_alloc();
  return invalid_file("{} is damaged: {}", label,
                      ZSTD_isError(got) ? ZSTD_getErrorName(got) : "too short");
}

}  // namespace stgs
