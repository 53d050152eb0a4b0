// SPDX-License-Identifier: Apache-2.0
// Compressed bytes of the importers (format/src/interchange/compression.h), decoded by the browser.
#include "interchange/compression.h"

#include <algorithm>

#include "host_decoding.h"

namespace stgs {

struct GzipReader::Stream {
  std::span<const std::uint8_t> content;  // the remaining bytes
};

// The content was requested with the name of the file.
GzipReader::GzipReader(std::span<const std::uint8_t>, std::string file)
    : file_(std::move(file)),
      stream_(std::make_unique<Stream>(
          Stream{web::host_decoding().content(web::Coding::kGzip, file_)})) {}

GzipReader::~GzipReader() = default;

Result<std::size_t> GzipReader::read_some(std::span<std::uint8_t> out) {
  auto& content = stream_->content;
  const auto part = content.first(std::min(out.size(), content.size()));
  std::copy(part.begin(), part.end(), out.begin());
  content = content.subspan(part.size());
  return part.size();
}

Status decompress_zstd(std::span<const std::uint8_t>, std::span<std::uint8_t>,
                       const std::string& label) {
  return unsupported("{}: compressed with zstd, which browsers do not decode; use 'stgs convert'",
                     label);
}

}  // namespace stgs
