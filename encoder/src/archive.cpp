// SPDX-License-Identifier: Apache-2.0
#include "archive.h"

#include <xxhash.h>

#include <memory>

#include "stgs/format/byte_source.h"
#include "stgs/format/output_file.h"

namespace stgs::encoder {
namespace {

using Checksum = std::uint64_t;
constexpr std::size_t kMagicBytes = sizeof(ArchiveKind::magic), kLayout = kMagicBytes - 1;

Checksum checksum_of(std::span<const std::uint8_t> bytes) {
  return XXH3_64bits(bytes.data(), bytes.size());
}

}  // namespace

ArchiveWriter::ArchiveWriter(const ArchiveKind& kind)
    : kind_(kind), bytes_(kind.magic, kind.magic + kMagicBytes) {}

Status ArchiveWriter::save(const std::string& path) {
  value(checksum_of(bytes_));
  if (kind_.max_bytes > 0 && bytes_.size() > kind_.max_bytes) {
    return unsupported(
        "{}: the {} takes {} bytes (expected at most {}); use fewer cameras or points", path,
        kind_.noun, bytes_.size(), kind_.max_bytes);
  }
  return write_file_atomically(path, bytes_);
}

Result<ArchiveReader> ArchiveReader::open(const std::string& path, const ArchiveKind& kind) {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_file(path));
  if (kind.max_bytes > 0 && source->size() > kind.max_bytes) {
    return invalid_file("{}: damaged {} (expected at most {} bytes, got {}); {}", path, kind.noun,
                        kind.max_bytes, source->size(), kind.if_damaged);
  }
  ArchiveReader reader;
  std::vector<std::uint8_t>& bytes = reader.bytes_;
  bytes.resize(source->size());
  STGS_TRY(source->read(0, bytes));
  if (bytes.size() < kMagicBytes + sizeof(Checksum) ||
      std::memcmp(bytes.data(), kind.magic, kLayout) != 0) {
    return invalid_file("{}: not an STGS {}; {}", path, kind.noun, kind.if_damaged);
  }
  if (bytes[kLayout] != static_cast<std::uint8_t>(kind.magic[kLayout])) {
    return unsupported("{}: {} of another version of stgs; {}", path, kind.noun, kind.if_other);
  }
  reader.position_ = kMagicBytes;
  reader.end_ = bytes.size() - sizeof(Checksum);
  Checksum stored = 0;
  std::memcpy(&stored, bytes.data() + reader.end_, sizeof(stored));
  if (stored != checksum_of(std::span(bytes).first(reader.end_))) {
    return invalid_file("{}: damaged {} (checksum mismatch); {}", path, kind.noun, kind.if_damaged);
  }
  return reader;
}

}  // namespace stgs::encoder
