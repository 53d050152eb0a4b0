// SPDX-License-Identifier: Apache-2.0
// Coding of integers in .4dgs files: zigzag, byte planes, zlib or zstd.
#include <zlib.h>
#include <zstd.h>
#include <zstd_errors.h>

#include <algorithm>

#include "interchange/compression.h"
#include "interchange/fourdgs_format.h"

namespace stgs::fourdgs {
namespace {

constexpr int kZlibLevel = 6;  // 9 takes 19 times as long for 1 %

enum Mode : std::uint8_t { kRaw = 0, kDelta = 1, kConstant = 2 };

std::int32_t unzigzag(std::uint32_t v) {
  return static_cast<std::int32_t>((v >> 1) ^ (0 - (v & 1)));
}
std::uint32_t zigzag(std::int32_t v) {
  const auto u = static_cast<std::uint32_t>(v);
  return (u << 1) ^ (v < 0 ? 0xFFFFFFFFu : 0u);
}

Status inflate_exactly(View packed, Bytes& out, const Place& place) {
  z_stream stream{};
  if (inflateInit(&stream) != Z_OK)
    return runtime_error("{}: zlib failed to initialise", place.file);
  std::size_t fed = 0, done = 0;
  int code = Z_OK;
  while (code == Z_OK) {
    // zlib counts bytes in 32 bits, and needs a pointer even for an empty result.
    std::uint8_t spare = 0;
    const std::size_t in = std::min<std::size_t>(packed.size() - fed, 1u << 30);
    const std::size_t space = std::min<std::size_t>(out.size() - done, 1u << 30);
    stream.next_in = const_cast<Bytef*>(packed.data() + fed);  // zlib does not modify it
    stream.avail_in = static_cast<uInt>(in);
    stream.next_out = space > 0 ? out.data() + done : &spare;
    stream.avail_out = static_cast<uInt>(space);
    code = inflate(&stream, Z_NO_FLUSH);
    fed += in - stream.avail_in;
    done += space - stream.avail_out;
  }
  inflateEnd(&stream);
  if (code == Z_MEM_ERROR) throw std::bad_alloc();
  if (code == Z_STREAM_END && done == out.size()) return {};
  return invalid_file("{}: zlib stream is damaged: {}{}", place.file,
                      code == Z_STREAM_END ? "too short"
                      : done == out.size() ? "too long, or wrong checksum"
                                           : "truncated or invalid",
                      place.text());
}

// Reverses the shuffle of bytes into planes. `out` has at least as many elements as a plane.
void unshuffle(View planes, std::size_t width, std::vector<std::int32_t>& out) {
  const std::size_t n = planes.size() / width;
  for (std::size_t i = 0; i < n; ++i) {
    std::uint32_t v = 0;
    for (std::size_t j = 0; j < width; ++j) v |= std::uint32_t{planes[j * n + i]} << (8 * j);
    out[i] = unzigzag(v);
  }
}

// Replaces differences to the previous element by values.
bool accumulate(Stream& stream) {
  for (std::size_t i = stream.channels; i < stream.values.size(); ++i) {
    const std::int64_t sum = std::int64_t{stream.values[i]} + stream.values[i - stream.channels];
    if (sum != static_cast<std::int32_t>(sum)) return false;
    stream.values[i] = static_cast<std::int32_t>(sum);
  }
  return true;
}

struct StreamHead {
  std::uint8_t attribute, width, mode, codec, channels;
  std::uint32_t count;
  View payload;
};

Result<StreamHead> read_head(ByteReader& in, const Place& place) {
  StreamHead h{};
  h.attribute = in.u8();
  h.width = in.u8();
  h.mode = in.u8();
  h.codec = in.u8();
  h.channels = in.u8();
  h.count = in.u32();
  h.payload = in.bytes(in.u64());
  if (in.ok()) return h;
  return invalid_file("{}: stream {} exceeds its record{}", place.file, h.attribute, place.text());
}

// Returns the number of channels of an attribute; 0: unknown.
std::size_t channels_of(std::uint8_t attribute) {
  if (attribute < kAttributes) return kChannels[attribute];
  return attribute == kGaussianId || attribute == kObjectId ? 1 : 0;
}

Result<Stream> decode(const StreamHead& h, std::size_t count, std::size_t channels,
                      ImportMemory& memory, const Place& place) {
  if (h.codec > kZstd) {
    return unsupported("{}: unknown coder {} of stream {} (expected 0, zlib, or 1, zstd){}",
                       place.file, h.codec, h.attribute, place.text());
  }
  if ((h.width != 1 && h.width != 2 && h.width != 4) || h.mode > kConstant) {
    return invalid_file("{}: invalid stream {} (width {}, mode {}){}", place.file, h.attribute,
                        h.width, h.mode, place.text());
  }
  if (h.count != count || h.channels != channels) {
    return invalid_file(
        "{}: wrong size of stream {} (expected {} elements of {} channels, got {} of {}){}",
        place.file, h.attribute, count, channels, h.count, h.channels, place.text());
  }
  Stream out{h.attribute, channels, count, {}, {}};
  if (count == 0) return out;
  const std::uint64_t symbols = channels * (h.mode == kConstant ? 1 : std::uint64_t{count});
  STGS_ASSIGN(const ChargedBytes planes,
              decompress(h.payload, static_cast<Codec>(h.codec), symbols * h.width, memory, place));
  STGS_ASSIGN(out.lease, memory.take(sizeof(std::int32_t) * channels * std::uint64_t{count},
                                     fmt::format("the values of {} Gaussians", count)));
  out.values.resize(channels * count);
  unshuffle(planes.value, h.width, out.values);
  if (h.mode == kConstant) {
    for (std::size_t i = channels; i < out.values.size(); ++i)
      out.values[i] = out.values[i - channels];
  } else if (h.mode == kDelta && !accumulate(out)) {
    return invalid_file("{}: values of stream {} exceed 32 bits{}", place.file, h.attribute,
                        place.text());
  }
  return out;
}

Result<std::vector<std::uint32_t>> as_unsigned(const Stream& stream, ImportMemory& memory) {
  STGS_ASSIGN(const Lease lease, memory.take(stream.lease.bytes(), "the identities of Gaussians"));
  return std::vector<std::uint32_t>(stream.values.begin(), stream.values.end());
}

// The coded form of symbols, after zigzag.
struct CodedSymbols {
  std::uint8_t width = 1;
  Bytes payload;
};

CodedSymbols encode(std::span<const std::int32_t> values) {
  std::uint32_t all = 0;
  for (std::int32_t v : values) all |= zigzag(v);
  CodedSymbols out;
  out.width = all > 0xFFFF ? 4 : all > 0xFF ? 2 : 1;
  Bytes planes(values.size() * out.width);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::uint32_t v = zigzag(values[i]);
    for (std::size_t j = 0; j < out.width; ++j) {
      planes[j * values.size() + i] = static_cast<std::uint8_t>(v >> (8 * j));
    }
  }
  uLongf size = compressBound(static_cast<uLong>(planes.size()));
  out.payload.resize(size);
  const int code = compress2(out.payload.data(), &size, planes.data(),
                             static_cast<uLong>(planes.size()), kZlibLevel);
  if (code != Z_OK) throw std::bad_alloc();  // the buffer is large enough
  out.payload.resize(size);
  return out;
}

// Returns the differences to the previous element; none if one exceeds 32 bits.
std::optional<std::vector<std::int32_t>> differences(std::span<const std::int32_t> values,
                                                     std::size_t channels) {
  std::vector<std::int32_t> out(values.begin(), values.end());
  for (std::size_t i = channels; i < values.size(); ++i) {
    const std::int64_t d = std::int64_t{values[i]} - values[i - channels];
    if (d != static_cast<std::int32_t>(d)) return {};
    out[i] = static_cast<std::int32_t>(d);
  }
  return out;
}

}  // namespace

Result<ChargedBytes> decompress(View packed, Codec codec, std::uint64_t bytes, ImportMemory& memory,
                                const Place& place) {
  if (bytes / (codec == kZstd ? kZstdRatio : kDeflateRatio) > packed.size()) {
    return invalid_file("{}: {} bytes do not fit in {} compressed bytes{}", place.file, bytes,
                        packed.size(), place.text());
  }
  ChargedBytes out;
  const std::uint64_t scratch = codec == kZstd ? kZstdScratch : kInflateScratch;
  STGS_ASSIGN(out.lease, memory.take(bytes + scratch, fmt::format("{} decoded bytes", bytes)));
  out.value.resize(static_cast<std::size_t>(bytes));
  if (codec == kDeflate) {
    STGS_TRY(inflate_exactly(packed, out.value, place));
  } else {
    const std::size_t got =
        ZSTD_decompress(out.value.data(), out.value.size(), packed.data(), packed.size());
    if (ZSTD_getErrorCode(got) == ZSTD_error_memory_allocation) throw std::bad_alloc();
    if (ZSTD_isError(got) || got != out.value.size()) {
      return invalid_file("{}: zstd stream is damaged: {}{}", place.file,
                          ZSTD_isError(got) ? ZSTD_getErrorName(got) : "too short", place.text());
    }
  }
  out.lease.resize(bytes);
  return out;
}

Result<ChargedBytes> unpack_chunk(View packed, const std::string& codec, std::uint64_t bytes,
                                  ImportMemory& memory, const Place& place) {
  if (codec == "deflate") return decompress(packed, kDeflate, bytes, memory, place);
  if (codec == "zstd") return decompress(packed, kZstd, bytes, memory, place);
  if (!codec.empty()) {
    return unsupported("{}: unknown coder of a chunk (expected deflate or zstd, got {}){}",
                       place.file, short_text(codec), place.text());
  }
  if (bytes != packed.size()) {
    return invalid_file("{}: wrong size of a chunk (expected {} bytes, got {}){}", place.file,
                        bytes, packed.size(), place.text());
  }
  ChargedBytes out;
  STGS_ASSIGN(out.lease, memory.take(bytes, "the bytes of a chunk"));
  out.value.assign(packed.begin(), packed.end());
  return out;
}

Status read_population(View block, std::size_t count, bool required, bool with_ids,
                       ImportMemory& memory, const Place& place, Population& out) {
  if (count / kMaxPerByte > block.size()) {
    return invalid_file("{}: {} Gaussians do not fit in {} bytes{}", place.file, count,
                        block.size(), place.text());
  }
  ByteReader in(block);
  std::array<bool, 256> seen{};
  while (in.left() > 0) {
    STGS_ASSIGN(const StreamHead head, read_head(in, place));
    if (seen[head.attribute]) {
      return invalid_file("{}: two streams {} in one chunk{}", place.file, head.attribute,
                          place.text());
    }
    seen[head.attribute] = true;
    const std::size_t channels = channels_of(head.attribute);
    if (channels == 0) continue;
    if (head.attribute == kGaussianId && !with_ids) {
      return invalid_file("{}: identities in a file of temporal model {}{}", place.file, kBirth,
                          place.text());
    }
    STGS_ASSIGN(Stream stream, decode(head, count, channels, memory, place));
    if (head.attribute == kGaussianId) {
      STGS_ASSIGN(out.ids, as_unsigned(stream, memory));
    } else if (head.attribute == kObjectId) {
      STGS_ASSIGN(out.objects, as_unsigned(stream, memory));
    } else {
      out.bins[head.attribute] = std::move(stream.values);
    }
    out.lease.merge(std::move(stream.lease));
  }
  for (std::size_t a = 0; a < kAttributes; ++a) {
    if (!required || seen[a] || count == 0) continue;
    return invalid_file("{}: a chunk lacks stream {}{}", place.file, a, place.text());
  }
  if (with_ids && !seen[kGaussianId] && count > 0) {
    return invalid_file("{}: a chunk lacks the identities of its Gaussians{}", place.file,
                        place.text());
  }
  for (const std::int32_t index : out.bins[kRotationIndex]) {
    if (index >= 0 && index <= 3) continue;
    return invalid_file("{}: invalid rotation index (expected 0 to 3, got {}){}", place.file, index,
                        place.text());
  }
  return {};
}

Result<Stream> read_band(View content, std::size_t count, int& band, ImportMemory& memory,
                         const Place& place) {
  ByteReader in(content);
  band = in.u8();
  if (band < 1 || band > kMaxBand) {
    return invalid_file("{}: invalid SH band (expected 1 to 3, got {}){}", place.file, band,
                        place.text());
  }
  STGS_ASSIGN(const StreamHead head, read_head(in, place));
  if (count / kMaxPerByte > content.size()) {
    return invalid_file("{}: the SH of {} Gaussians do not fit in {} bytes{}", place.file, count,
                        content.size(), place.text());
  }
  const BandRange range = band_range(band);
  STGS_ASSIGN(Stream stream, decode(head, count, 3 * (range.last - range.first), memory, place));
  for (const std::int32_t v : stream.values) {
    if (v >= 0 && v <= 255) continue;
    return invalid_file("{}: invalid SH coefficient (expected 0 to 255, got {}){}", place.file, v,
                        place.text());
  }
  return stream;
}

void write_stream(ByteWriter& out, std::uint8_t attribute, std::size_t channels,
                  std::span<const std::int32_t> values) {
  const std::size_t count = values.size() / channels;
  const std::optional<std::vector<std::int32_t>> deltas = differences(values, channels);
  std::uint8_t mode = kRaw;
  CodedSymbols coded;
  if (count > 1 && deltas &&
      std::all_of(deltas->begin() + static_cast<std::ptrdiff_t>(channels), deltas->end(),
                  [](std::int32_t d) { return d == 0; })) {
    mode = kConstant;
    coded = encode(values.first(channels));
  } else {
    coded = encode(values);
    if (deltas) {
      CodedSymbols other = encode(*deltas);
      if (other.payload.size() < coded.payload.size()) {
        mode = kDelta;
        coded = std::move(other);
      }
    }
  }
  out.u8(attribute);
  out.u8(coded.width);
  out.u8(mode);
  out.u8(kDeflate);
  out.u8(static_cast<std::uint8_t>(channels));
  out.u32(static_cast<std::uint32_t>(count));
  out.u64(coded.payload.size());
  out.bytes(coded.payload);
}

}  // namespace stgs::fourdgs
