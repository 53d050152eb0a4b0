// SPDX-License-Identifier: Apache-2.0
// Reading SPZ versions 2, 3 and 4.
#include <algorithm>
#include <cmath>

#include "core/bytes.h"
#include "interchange/compression.h"
#include "interchange/import.h"
#include "interchange/spz.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

using Bytes = std::vector<std::uint8_t>;
using View = std::span<const std::uint8_t>;

constexpr std::uint32_t kAxesExtension = 0xADBE0003;  // by Adobe: the axes of a file
constexpr std::uint64_t kMaxExtensionNotes = 8;

struct Header {
  std::uint32_t version = 0, primitives = 0;
  int degree = 0, fraction_bits = 0;
  std::uint8_t flags = 0, streams = 0;
  std::uint32_t toc = 0;  // byte of the table of contents; version 4
};

// Signs that convert the file's axes to OpenCV's.
struct Axes {
  int x = 1, y = -1, z = -1;
};

struct SpzContent {
  Header header;
  std::array<Bytes, spz::kArrays> arrays;
  Lease lease;  // of the arrays, and of their decoders
  Axes axes;
};

Result<Header> parse_header(View bytes, const std::string& file, ImportMemory& memory) {
  ByteReader in(bytes);
  Header header;
  if (in.u32() != spz::kMagic) return invalid_file("{}: not an SPZ file", file);
  header.version = in.u32();
  header.primitives = in.u32();
  header.degree = in.u8();
  header.fraction_bits = in.u8();
  header.flags = in.u8();
  header.streams = in.u8();
  if (header.version >= 4) header.toc = in.u32();
  if (!in.ok()) return invalid_file("{}: the file is truncated within its header", file);
  if (header.version < 2 || header.version > 4) {
    return unsupported("{}: unsupported SPZ version (expected 2, 3 or 4, got {})", file,
                       header.version);
  }
  if (header.degree > spz::kMaxDegree) {
    return invalid_file("{}: invalid SH degree (expected 0 to {}, got {})", file, spz::kMaxDegree,
                        header.degree);
  }
  if (header.fraction_bits > 30) {
    return invalid_file("{}: invalid number of fractional bits (expected at most 30, got {})", file,
                        header.fraction_bits);
  }
  STGS_TRY(memory.check_count(header.primitives));
  return header;
}

// Parses records of type, length and payload. Skips unknown ones, with notes.
Result<Axes> parse_extensions(View bytes, const std::string& file, ConversionNotes* notes) {
  ByteReader in(bytes);
  Axes axes;
  std::uint64_t unknown = 0;
  while (in.left() > 0) {
    const std::uint32_t type = in.u32();
    const View payload = in.bytes(in.u32());
    if (!in.ok()) return invalid_file("{}: truncated SPZ extension", file);
    if (type != kAxesExtension) {
      if (++unknown <= kMaxExtensionNotes) {
        note(notes, fmt::format("dropped the unknown SPZ extension {:#010x}", type));
      }
      continue;
    }
    const std::uint32_t value = ByteReader(payload).u32();
    if (value > 8) {
      return unsupported("{}: unsupported axes (SPZ coordinate system {})", file, value);
    }
    if (value == 0) continue;  // unspecified
    // Bits of value - 1: x right, y up, z forward.
    const std::uint32_t bits = value - 1;
    axes = {bits & 1 ? 1 : -1, bits & 2 ? -1 : 1, bits & 4 ? 1 : -1};
  }
  if (unknown > kMaxExtensionNotes) {
    note(notes,
         fmt::format("dropped {} more unknown SPZ extensions", unknown - kMaxExtensionNotes));
  }
  return axes;
}

// Checks that the compressed bytes can contain the arrays, then allocates them. `scratch`: memory
// of the decoders.
Status allocate_arrays(SpzContent& content, std::uint64_t compressed, std::uint64_t ratio,
                       std::uint64_t scratch, ImportMemory& memory) {
  const auto strides = spz::strides(content.header.version, content.header.degree);
  const std::uint64_t n = content.header.primitives;
  std::uint64_t bytes = 0;
  for (const std::size_t stride : strides) bytes += n * stride;
  if (bytes / ratio > compressed) {
    return invalid_file("{}: {} primitives do not fit in {} bytes", memory.name(), n, compressed);
  }
  STGS_ASSIGN(content.lease,
              memory.take(bytes + scratch, fmt::format("the arrays of {} primitives", n)));
  for (std::size_t a = 0; a < strides.size(); ++a) content.arrays[a].resize(n * strides[a]);
  return {};
}

Result<SpzContent> read_version_4(View bytes, const std::string& file, ImportMemory& memory,
                                  ConversionNotes* notes) {
  SpzContent content;
  STGS_ASSIGN(content.header, parse_header(bytes, file, memory));
  const Header& header = content.header;
  if (header.version < 4) {
    return invalid_file("{}: SPZ version {} must be wrapped in gzip", file, header.version);
  }
  const std::uint64_t toc_end = header.toc + std::uint64_t{header.streams} * spz::kTocEntry;
  if (header.toc < spz::kHeader || toc_end > bytes.size()) {
    return invalid_file("{}: invalid table of contents (ends at byte {} of {})", file, toc_end,
                        bytes.size());
  }
  if ((header.flags & spz::kHasExtensions) != 0) {
    const View extensions = bytes.subspan(spz::kHeader, header.toc - spz::kHeader);
    STGS_ASSIGN(content.axes, parse_extensions(extensions, file, notes));
  }
  STGS_TRY(allocate_arrays(content, bytes.size(), kZstdRatio, spz::kArrays * kZstdScratch, memory));
  std::vector<Bytes*> arrays;
  for (Bytes& array : content.arrays) {
    if (!array.empty()) arrays.push_back(&array);
  }
  if (arrays.size() != header.streams) {
    return invalid_file("{}: wrong number of streams (expected {}, got {})", file, arrays.size(),
                        header.streams);
  }
  ByteReader toc(bytes.subspan(header.toc));
  ByteReader body(bytes.subspan(static_cast<std::size_t>(toc_end)));
  std::vector<View> frames;
  for (const Bytes* array : arrays) {
    const std::uint64_t stored = toc.u64(), raw = toc.u64();
    frames.push_back(body.bytes(stored));
    if (!body.ok() || raw != array->size()) {
      return invalid_file("{}: invalid size of SPZ stream {} ({} bytes, {} bytes decoded)", file,
                          frames.size() - 1, stored, raw);
    }
  }
  std::vector<Status> statuses(frames.size());
  parallel_for(std::size_t{0}, frames.size(), [&](std::size_t i) {
    statuses[i] = decompress_zstd(frames[i], *arrays[i], fmt::format("{}: SPZ stream {}", file, i));
  });
  for (const Status& status : statuses) STGS_TRY(status);
  return content;
}

constexpr std::size_t kMaxExtensionBytes = 1 << 20;

Result<SpzContent> read_gzipped(View bytes, const std::string& file, ImportMemory& memory,
                                ConversionNotes* notes) {
  GzipReader gzip(bytes, file);
  std::array<std::uint8_t, spz::kOldHeader> head{};
  STGS_TRY(gzip.read(head));
  SpzContent content;
  if (ByteReader(View(head).subspan(4)).u32() > 3) {
    return unsupported("{}: SPZ version above 3 in a gzip wrapper", file);
  }
  STGS_ASSIGN(content.header, parse_header(head, file, memory));
  STGS_TRY(allocate_arrays(content, bytes.size(), kDeflateRatio,
                           kInflateScratch + kMaxExtensionBytes, memory));
  for (Bytes& array : content.arrays) STGS_TRY(gzip.read(array));
  // Read to the end, which verifies the checksum.
  Bytes extensions(kMaxExtensionBytes);
  STGS_ASSIGN(const std::size_t size, gzip.read_some(extensions));
  if ((content.header.flags & spz::kHasExtensions) != 0) {
    STGS_ASSIGN(content.axes, parse_extensions(View(extensions).first(size), file, notes));
  }
  return content;
}

// Decodes the three smallest of x y z w, with 9 bits and a sign each. The first two bits are the
// index of the largest one.
std::array<float, 4> smallest_three(const std::uint8_t* bytes) {
  const std::uint32_t word = ByteReader({bytes, 4}).u32();
  const std::size_t largest = word >> 30;
  std::array<float, 4> q{};
  float sum = 0.0f;
  int shift = 20;
  for (std::size_t c = 0; c < 4; ++c) {
    if (c == largest) continue;
    const std::uint32_t field = word >> shift;
    q[c] = spz::kHalfRoot * static_cast<float>(field & 511u) / 511.0f;
    if ((field & 512u) != 0) q[c] = -q[c];
    sum += q[c] * q[c];
    shift -= 10;
  }
  q[largest] = std::sqrt(std::max(0.0f, 1.0f - sum));
  return q;
}

// Decodes x y z as bytes around 127.5; w follows from the length. Version 2.
std::array<float, 4> first_three(const std::uint8_t* bytes) {
  std::array<float, 4> q{};
  float sum = 0.0f;
  for (std::size_t c = 0; c < 3; ++c) {
    q[c] = static_cast<float>(bytes[c]) / 127.5f - 1.0f;
    sum += q[c] * q[c];
  }
  q[3] = std::sqrt(std::max(0.0f, 1.0f - sum));
  return q;
}

float fixed_point(const std::uint8_t* bytes, float unit) {
  const std::uint32_t word = bytes[0] | bytes[1] << 8 | static_cast<std::uint32_t>(bytes[2]) << 16;
  const auto value = static_cast<std::int32_t>(word << 8) >> 8;
  return static_cast<float>(value) * unit;
}

void unpack(const SpzContent& content, std::size_t i, Gaussians4D& set) {
  const Header& header = content.header;
  const auto& arrays = content.arrays;
  const float unit = std::ldexp(1.0f, -header.fraction_bits);
  const auto coefficients = static_cast<std::size_t>(set.sh_coefficients());
  float* sh = set.sh.data() + 3 * i * coefficients;
  for (std::size_t c = 0; c < 3; ++c) {
    set.position[3 * i + c] = fixed_point(arrays[spz::kPositions].data() + 3 * (3 * i + c), unit);
    set.log_scale[3 * i + c] = static_cast<float>(arrays[spz::kScales][3 * i + c]) / 16.0f - 10.0f;
    sh[c] =
        (static_cast<float>(arrays[spz::kColours][3 * i + c]) / 255.0f - 0.5f) / spz::kColourScale;
  }
  const std::array<float, 4> q = header.version >= 3
                                     ? smallest_three(arrays[spz::kRotations].data() + 4 * i)
                                     : first_three(arrays[spz::kRotations].data() + 3 * i);
  for (std::size_t c = 0; c < 4; ++c) set.rotation[4 * i + c] = q[(c + 3) % 4];  // w first
  set.opacity_logit[i] = logit_of_byte(arrays[spz::kOpacities][i]);
  const auto stored = 3 * static_cast<std::size_t>(spz::rest_coefficients(header.degree));
  for (std::size_t k = 3; k < 3 * coefficients; ++k) {
    const std::uint8_t value = arrays[spz::kSh][i * stored + k - 3];
    sh[k] = (static_cast<float>(value) - 128.0f) / 128.0f;
  }
}

}  // namespace

Result<Scene> read_spz(const ByteSource& source, const ReadLimits& limits, ConversionNotes* notes) {
  ImportMemory memory(limits, source.name());
  STGS_ASSIGN(const Lease lease, memory.take(source.size(), "the bytes of the file"));
  Bytes bytes(static_cast<std::size_t>(source.size()));
  STGS_TRY(source.read(0, bytes));
  STGS_ASSIGN(const SpzContent content, is_gzip(bytes)
                                            ? read_gzipped(bytes, source.name(), memory, notes)
                                            : read_version_4(bytes, source.name(), memory, notes));
  if (content.header.degree > 3) note(notes, "dropped SH of degree 4");
  Gaussians4D set;
  set.sh_degree = std::min(content.header.degree, 3);
  STGS_ASSIGN(const Lease floats, memory.take_set(content.header.primitives, set.sh_degree));
  set.resize(content.header.primitives);
  parallel_blocks(std::size_t{0}, set.size(), kPrimitivesPerTask,
                  [&](std::size_t first, std::size_t last) {
                    for (std::size_t i = first; i < last; ++i) unpack(content, i, set);
                  });
  flip_axes(set, content.axes.x, content.axes.y, content.axes.z);
  Scene scene = finish_import(std::move(set), notes);
  if ((content.header.flags & spz::kAntialiased) != 0) scene.metadata.kernel = math::kBandLimited;
  return scene;
}

}  // namespace stgs
