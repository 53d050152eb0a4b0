// SPDX-License-Identifier: Apache-2.0
// Decoders of the importers (format/src/interchange/compression.h) without zlib and libzstd.
#include "interchange/compression.h"

#include "container/container.h"
#include "core/bytes.h"
#include "unpack/inflate.h"
#include "unpack/zstd.h"

namespace stgs {

struct GzipReader::Stream {
  std::span<const std::uint8_t> body;  // behind the header; empty if the header is invalid
  web::Inflate inflate;
  std::uint32_t checksum = 0, size = 0;  // of what was decoded; the size modulo 2^32
  bool has_ended = false;
};

namespace {

// Returns the bytes behind the header (RFC 1952, 2.3); none if it is invalid.
std::span<const std::uint8_t> gzip_body(std::span<const std::uint8_t> bytes) {
  constexpr int kHasChecksum = 2, kHasExtra = 4, kHasName = 8, kHasComment = 16, kReserved = 0xE0;
  ByteReader in(bytes);
  const std::uint32_t magic = in.u16();
  const int method = in.u8(), flags = in.u8();
  in.bytes(6);  // time, kind of compression, system
  if (magic != 0x8B1F || method != 8 || (flags & kReserved) != 0) return {};
  if ((flags & kHasExtra) != 0) in.bytes(in.u16());
  for (const int flag : {kHasName, kHasComment}) {
    while ((flags & flag) != 0 && in.ok() && in.u8() != 0) {
    }
  }
  if ((flags & kHasChecksum) != 0) in.u16();
  return in.ok() ? bytes.subspan(in.position()) : std::span<const std::uint8_t>();
}

}  // namespace

GzipReader::GzipReader(std::span<const std::uint8_t> bytes, std::string file)
    : file_(std::move(file)) {
  const auto body = gzip_body(bytes);
  stream_.reset(new Stream{body, web::Inflate(body)});
}

GzipReader::~GzipReader() = default;

Result<std::size_t> GzipReader::read_some(std::span<std::uint8_t> out) {
  Stream& stream = *stream_;
  if (stream.has_ended) return std::size_t{0};
  const auto damaged = [&] {
    return invalid_file("{}: gzip stream is damaged or truncated (byte {})", file_,
                        stream.inflate.position());
  };
  const std::optional<std::size_t> done = stream.inflate.read(out);
  if (!done) return damaged();
  stream.checksum = checksum(out.first(*done), stream.checksum);
  stream.size += static_cast<std::uint32_t>(*done);
  if (*done < out.size()) {
    ByteReader trailer(stream.body.subspan(stream.inflate.position()));
    stream.has_ended = true;
    if (trailer.u32() != stream.checksum || trailer.u32() != stream.size) return damaged();
  }
  return *done;
}

Status GzipReader::read(std::span<std::uint8_t> out) {
  STGS_ASSIGN(const std::size_t got, read_some(out));
  if (got == out.size()) return {};
  return invalid_file("{}: gzip stream is too short by {} bytes", file_, out.size() - got);
}

Status decompress_zstd(std::span<const std::uint8_t> frames, std::span<std::uint8_t> out,
                       const std::string& label) {
  const char* const problem = web::decode_zstd(frames, out);
  return problem == nullptr ? Status() : invalid_file("{} is damaged: {}", label, problem);
}

}  // namespace stgs
