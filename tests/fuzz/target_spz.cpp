// SPDX-License-Identifier: Apache-2.0
// SPZ: versions 2 and 3 in gzip, version 4 with one zstd frame per array.
//
// Unpacked, a version 4 file is its header, its table of contents and the unpacked arrays; both
// size fields of a table entry then hold the unpacked size.
#include <zlib.h>
#include <zstd.h>

#include <cstring>

#include "imported.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

constexpr std::size_t kHeader = 32, kTocEntry = 16, kMaxBytes = 1 << 20;

template <typename Value>
Value get(View bytes, std::size_t at) {
  Value v{};
  if (at <= bytes.size() && sizeof v <= bytes.size() - at) std::memcpy(&v, &bytes[at], sizeof v);
  return v;
}

bool is_gzip(View bytes) {
  return bytes.size() >= 2 && bytes[0] == 0x1F && bytes[1] == 0x8B;
}

Bytes gzip(View bytes) {
  z_stream stream{};
  deflateInit2(&stream, 6, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY);
  Bytes out(deflateBound(&stream, bytes.size()) + 32);
  stream.next_in = const_cast<Bytef*>(bytes.data());
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = out.data();
  stream.avail_out = static_cast<uInt>(out.size());
  deflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

Bytes gunzip(View bytes) {
  z_stream stream{};
  inflateInit2(&stream, 16 + MAX_WBITS);
  Bytes out(kMaxBytes);
  stream.next_in = const_cast<Bytef*>(bytes.data());
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = out.data();
  stream.avail_out = static_cast<uInt>(out.size());
  inflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  inflateEnd(&stream);
  return out;
}

// The table of contents of a version 4 file; no entries if it does not fit into the file.
struct Toc {
  std::size_t at = 0, entries = 0;
};
Toc toc_of(View file) {
  Toc toc{get<std::uint32_t>(file, 16), get<std::uint8_t>(file, 15)};
  if (get<std::uint32_t>(file, 4) != 4 || toc.at > file.size() ||
      toc.entries > (file.size() - toc.at) / kTocEntry) {
    toc.entries = 0;
  }
  return toc;
}

// Replaces each array by change(array) and updates its table entry.
template <typename Change>
Bytes replace_arrays(View file, std::size_t size_field, const Change& change) {
  const Toc toc = toc_of(file);
  const std::size_t body = toc.at + toc.entries * kTocEntry;
  if (toc.entries == 0) return {file.begin(), file.end()};
  Bytes out(file.begin(), file.begin() + static_cast<std::ptrdiff_t>(body));
  std::size_t at = body;
  for (std::size_t i = 0; i < toc.entries; ++i) {
    const std::size_t entry = toc.at + i * kTocEntry;
    const auto size = get<std::uint64_t>(file, entry + size_field);
    if (size > file.size() - at) break;
    const Bytes array = change(file.subspan(at, size));
    at += size;
    const std::uint64_t stored = array.size();
    std::memcpy(&out[entry], &stored, sizeof stored);
    out.insert(out.end(), array.begin(), array.end());
  }
  out.insert(out.end(), file.begin() + static_cast<std::ptrdiff_t>(at), file.end());
  return out;
}

Bytes unpack(View input) {
  if (is_gzip(input)) return gunzip(input);
  return replace_arrays(input, 0, [](View frame) {
    const unsigned long long size = ZSTD_getFrameContentSize(frame.data(), frame.size());
    Bytes array(size > kMaxBytes ? 0 : static_cast<std::size_t>(size));
    const std::size_t size_or_error =
        ZSTD_decompress(array.data(), array.size(), frame.data(), frame.size());
    array.resize(ZSTD_isError(size_or_error) ? 0 : size_or_error);
    return array;
  });
}

Bytes repack(Bytes form, Repair repair) {
  if (get<std::uint32_t>(form, 4) < 4) return gzip(form);
  if (repair == Repair::kNothing) return form;
  // With kSizes, the arrays have the sizes of the unpacked size fields. With kChecksums, a mutated
  // size field stays wrong, and the reader must detect it.
  return replace_arrays(form, repair == Repair::kSizes ? 8 : 0, [](View array) {
    Bytes frame(ZSTD_compressBound(array.size()));
    frame.resize(ZSTD_compress(frame.data(), frame.size(), array.data(), array.size(), 1));
    return frame;
  });
}

std::vector<Unit> units(View form) {
  std::vector<Unit> out = {{0, std::min(form.size(), kHeader)}};
  const Toc toc = toc_of(form);
  for (std::size_t i = 0; i < toc.entries; ++i)
    out.push_back({toc.at + i * kTocEntry, toc.at + (i + 1) * kTocEntry});
  return out;
}

// Versions 2 and 3: one array after another.
Bytes old_version(std::uint32_t version, std::uint32_t primitives, std::uint8_t degree) {
  const std::size_t sh_bytes = 3 * ((degree + 1u) * (degree + 1u) - 1u);
  Bytes form(16 + primitives * (9 + 1 + 3 + 3 + (version == 3 ? 4 : 3) + sh_bytes));
  for (std::size_t i = 16; i < form.size(); ++i) form[i] = static_cast<std::uint8_t>(i * 31);
  std::memcpy(form.data(), "NGSP", 4);
  std::memcpy(&form[4], &version, 4);
  std::memcpy(&form[8], &primitives, 4);
  form[12] = degree;
  form[13] = 12;
  return gzip(form);
}

std::vector<Bytes> seeds() {
  std::vector<Bytes> out = {old_version(2, 3, 1), old_version(3, 5, 3), old_version(3, 1, 4)};
  for (const int degree : {0, 3}) {
    auto bytes = write_spz(testing::random_scene(7, degree, 1, 5).gaussians);
    require(bytes.ok(), "seeds can be written");
    out.push_back(std::move(*bytes));
  }
  return out;
}

}  // namespace

const Target stgs::fuzz::kTarget{"spz", seeds, unpack, repack, units, import_memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ConversionNotes notes;
  check_import(read_spz(*memory_source(Bytes(data, data + size), "input"), kImportLimits, &notes));
  return 0;
}
