// SPDX-License-Identifier: Apache-2.0
#include "unpack/zstd.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

#include "core/bytes.h"
#include "unpack/fse.h"

namespace stgs::web {
namespace {

using View = std::span<const std::uint8_t>;

constexpr std::uint32_t kFrameMagic = 0xFD2FB528, kSkippableMagic = 0x184D2A50;
constexpr std::size_t kMaxBlock = 128 << 10;
constexpr const char* kDamaged = "damaged";
constexpr const char* kTruncated = "truncated";

// A code of literal lengths, match lengths or offsets.
struct Field {
  FseTable table;
  std::span<const std::int16_t> predefined;
  int predefined_accuracy, max_accuracy, symbols;
};

// RFC 8878 3.1.1.3.2.1.1: extra bits of the codes; a code begins where the one before ends.
constexpr std::array<std::uint8_t, 36> kLiteralBits = {0, 0, 0, 0, 0, 0,  0,  0,  0,  0,  0,  0,
                                                       0, 0, 0, 0, 1, 1,  1,  1,  2,  2,  3,  3,
                                                       4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
constexpr std::array<std::uint8_t, 53> kMatchBits = {
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,  0,  0,  0,  0,  0,  0, 0,
    0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 3, 3, 4, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
constexpr int kOffsetCodes = 32;

template <std::size_t N>
constexpr std::array<std::uint32_t, N> bases(const std::array<std::uint8_t, N>& bits,
                                             std::uint32_t first) {
  std::array<std::uint32_t, N> out{};
  for (std::size_t code = 0; code < N; first += 1u << bits[code++]) out[code] = first;
  return out;
}
constexpr auto kLiteralBases = bases(kLiteralBits, 0);
constexpr auto kMatchBases = bases(kMatchBits, 3);

// RFC 8878 3.1.1.3.2.2.
constexpr std::array<std::int16_t, 36> kLiteralDefault = {4, 3, 2, 2, 2, 2, 2, 2, 2,  2,  2,  2,
                                                          2, 1, 1, 1, 2, 2, 2, 2, 2,  2,  2,  2,
                                                          2, 3, 2, 1, 1, 1, 1, 1, -1, -1, -1, -1};
constexpr std::array<std::int16_t, 53> kMatchDefault = {
    1, 4, 3, 2, 2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,  1,  1,  1,  1,  1,  1, 1,
    1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1, -1, -1};
constexpr std::array<std::int16_t, 29> kOffsetDefault = {
    1, 1, 1, 1, 1, 1, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1};

// Decodes the blocks of one frame, one after the other.
class FrameDecoder {
 public:
  // Decodes to the begin of `out`.
  explicit FrameDecoder(std::span<std::uint8_t> out) : out_(out) {}

  const char* block(View content);
  const char* append(View bytes);
  const char* fill(std::uint8_t byte, std::size_t count);
  std::size_t done() const { return done_; }

 private:
  const char* read_literals(ByteReader& in);
  const char* read_coded_literals(ByteReader& in, int type, int head);
  bool read_field(ByteReader& in, int mode, Field& field);
  const char* run_sequences(BackwardBits& in, std::size_t count);
  // Returns the distance that an offset value stands for (3.1.1.5); 0: invalid.
  std::uint64_t distance(std::uint64_t value, bool has_literals);
  const char* copy_match(std::uint64_t distance, std::size_t length);

  std::span<std::uint8_t> out_;
  std::size_t done_ = 0;
  std::vector<std::uint8_t> literals_;
  std::size_t literals_used_ = 0;
  LiteralCode literal_code_;
  Field literal_lengths_{{}, kLiteralDefault, 6, 9, 36},
      match_lengths_{{}, kMatchDefault, 6, 9, 53}, offsets_{{}, kOffsetDefault, 5, 8, kOffsetCodes};
  std::array<std::uint64_t, 3> recent_ = {1, 4, 8};
};

const char* FrameDecoder::append(View bytes) {
  if (bytes.size() > out_.size() - done_) return "longer than stated";
  std::copy(bytes.begin(), bytes.end(), out_.begin() + static_cast<std::ptrdiff_t>(done_));
  done_ += bytes.size();
  return nullptr;
}

const char* FrameDecoder::fill(std::uint8_t byte, std::size_t count) {
  if (count > out_.size() - done_) return "longer than stated";
  std::fill_n(out_.begin() + static_cast<std::ptrdiff_t>(done_), count, byte);
  done_ += count;
  return nullptr;
}

// RFC 8878 3.1.1.3.1.
const char* FrameDecoder::read_literals(ByteReader& in) {
  literals_used_ = 0;
  const std::uint32_t head = in.u8();
  const int type = head & 3, form = head >> 2 & 3;
  if (type >= 2) return read_coded_literals(in, type, static_cast<int>(head));
  std::size_t size = head >> 3;
  if (form == 1) size = head >> 4 | std::size_t{in.u8()} << 4;
  if (form == 3) size = head >> 4 | std::size_t{in.u16()} << 4;
  if (size > kMaxBlock) return kDamaged;
  if (type == 1) {
    literals_.assign(size, in.u8());
  } else {
    const View bytes = in.bytes(size);
    literals_.assign(bytes.begin(), bytes.end());
  }
  return in.ok() ? nullptr : kTruncated;
}

const char* FrameDecoder::read_coded_literals(ByteReader& in, int type, int head) {
  const int form = head >> 2 & 3, bits = form < 2 ? 10 : form == 2 ? 14 : 18;
  std::uint64_t sizes = static_cast<std::uint64_t>(head) >> 4;
  for (int at = 4; at < 2 * bits; at += 8) sizes |= std::uint64_t{in.u8()} << at;
  const std::uint64_t mask = (std::uint64_t{1} << bits) - 1;
  const auto size = static_cast<std::size_t>(sizes & mask);
  View coded = in.bytes(sizes >> bits & mask);
  if (!in.ok()) return kTruncated;
  if (size > kMaxBlock) return kDamaged;
  if (type == 2) {
    const std::size_t description = literal_code_.read(coded);
    if (description == 0) return kDamaged;
    coded = coded.subspan(description);
  }
  if (!literal_code_.is_set()) return kDamaged;
  literals_.resize(size);
  if (form == 0) return literal_code_.decode(coded, literals_) ? nullptr : kDamaged;
  // Four streams, of which the sizes of three are stated.
  ByteReader streams(coded);
  std::array<std::size_t, 3> stored{};
  for (std::size_t& bytes : stored) bytes = streams.u16();
  const std::size_t part = (size + 3) / 4;
  if (3 * part > size) return kDamaged;
  for (std::size_t i = 0; i < 4; ++i) {
    const View stream = streams.bytes(i < 3 ? stored[i] : streams.left());
    const auto target = std::span(literals_).subspan(i * part, i < 3 ? part : size - 3 * part);
    if (!streams.ok() || !literal_code_.decode(stream, target)) return kDamaged;
  }
  return nullptr;
}

// RFC 8878 3.1.1.3.2.1.
bool FrameDecoder::read_field(ByteReader& in, int mode, Field& field) {
  if (mode == 0) {
    field.table.set(field.predefined, field.predefined_accuracy);
  } else if (mode == 1) {
    const std::uint8_t symbol = in.u8();
    if (symbol >= field.symbols) return false;
    field.table.set_single(symbol);
  } else if (mode == 2) {
    ByteReader rest = in;
    const std::size_t bytes =
        field.table.read(rest.bytes(rest.left()), field.symbols, field.max_accuracy);
    if (bytes == 0) return false;
    in.bytes(bytes);
  }
  return in.ok() && field.table.is_set();
}

std::uint64_t FrameDecoder::distance(std::uint64_t value, bool has_literals) {
  if (value > 3) {
    recent_ = {value - 3, recent_[0], recent_[1]};
    return recent_[0];
  }
  const std::uint64_t index = value - 1 + (has_literals ? 0 : 1);
  if (index == 0) return recent_[0];
  const std::uint64_t found = index < 3 ? recent_[index] : recent_[0] - 1;
  if (index > 1) recent_[2] = recent_[1];
  recent_[1] = recent_[0];
  recent_[0] = found;
  return found;
}

const char* FrameDecoder::copy_match(std::uint64_t distance, std::size_t length) {
  if (distance == 0 || distance > done_) return kDamaged;
  if (length > out_.size() - done_) return "longer than stated";
  std::uint8_t* const to = out_.data() + done_;
  const std::uint8_t* const from = to - distance;
  for (std::size_t i = 0; i < length; ++i) to[i] = from[i];  // the two may overlap
  done_ += length;
  return nullptr;
}

// RFC 8878 3.1.1.4.
const char* FrameDecoder::run_sequences(BackwardBits& in, std::size_t count) {
  unsigned literal = literal_lengths_.table.first_state(in);
  unsigned offset = offsets_.table.first_state(in);
  unsigned match = match_lengths_.table.first_state(in);
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t offset_code = offsets_.table.symbol(offset);
    const std::uint64_t value = (std::uint64_t{1} << offset_code) + in.take(offset_code);
    const std::uint8_t match_code = match_lengths_.table.symbol(match);
    const std::size_t match_length =
        kMatchBases[match_code] + static_cast<std::size_t>(in.take(kMatchBits[match_code]));
    const std::uint8_t literal_code = literal_lengths_.table.symbol(literal);
    const std::size_t literal_length =
        kLiteralBases[literal_code] + static_cast<std::size_t>(in.take(kLiteralBits[literal_code]));
    if (literal_length > literals_.size() - literals_used_) return kDamaged;
    if (const char* problem = append(View(literals_).subspan(literals_used_, literal_length))) {
      return problem;
    }
    literals_used_ += literal_length;
    const std::uint64_t found = distance(value, literal_length > 0);
    if (const char* problem = copy_match(found, match_length)) return problem;
    if (i + 1 == count) break;
    literal = literal_lengths_.table.next_state(literal, in);
    match = match_lengths_.table.next_state(match, in);
    offset = offsets_.table.next_state(offset, in);
    if (in.left() < 0) return kDamaged;
  }
  return in.left() == 0 ? nullptr : kDamaged;
}

const char* FrameDecoder::block(View content) {
  ByteReader in(content);
  if (const char* problem = read_literals(in)) return problem;
  std::size_t count = in.u8();
  if (count == 255) {
    count = in.u16() + std::size_t{0x7F00};
  } else if (count >= 128) {
    count = (count - 128) << 8 | in.u8();
  }
  if (!in.ok()) return kTruncated;
  if (count > 0) {
    const int modes = in.u8();
    if ((modes & 3) != 0 || !read_field(in, modes >> 6, literal_lengths_) ||
        !read_field(in, modes >> 4 & 3, offsets_) ||
        !read_field(in, modes >> 2 & 3, match_lengths_)) {
      return kDamaged;
    }
    BackwardBits bits(in.bytes(in.left()));
    if (const char* problem = run_sequences(bits, count)) return problem;
  } else if (in.left() != 0) {
    return kDamaged;
  }
  return append(View(literals_).subspan(literals_used_));
}

// Decodes the frame behind its magic number. `done`: bytes of `out` before and after it.
const char* decode_frame(ByteReader& in, std::span<std::uint8_t> out, std::size_t& done) {
  const int flags = in.u8();
  const bool is_single = (flags & 0x20) != 0, has_checksum = (flags & 4) != 0;
  if ((flags & 8) != 0) return kDamaged;
  if (!is_single) in.u8();  // the window: everything before is in memory
  constexpr std::array<int, 4> kDictionary = {0, 1, 2, 4}, kContent = {1, 2, 4, 8};
  for (const std::uint8_t byte : in.bytes(static_cast<std::uint64_t>(kDictionary[flags & 3]))) {
    if (byte != 0) return "compressed with a dictionary";
  }
  const bool states_size = is_single || flags >> 6 != 0;
  std::uint64_t size = flags >> 6 == 1 ? 256 : 0;
  if (states_size) {
    for (int i = 0; i < kContent[flags >> 6]; ++i) size += std::uint64_t{in.u8()} << 8 * i;
    if (size > out.size() - done) return "longer than stated";
  }
  FrameDecoder frame(out.subspan(done));
  for (bool is_last = false; !is_last;) {
    const std::uint32_t head = in.u16() | std::uint32_t{in.u8()} << 16;
    is_last = (head & 1) != 0;
    const std::size_t bytes = head >> 3;
    if (!in.ok()) return kTruncated;
    if (bytes > kMaxBlock) return kDamaged;
    const int type = head >> 1 & 3;
    const View content = in.bytes(type == 1 ? 1 : bytes);
    if (!in.ok()) return kTruncated;
    const std::size_t before = frame.done();
    const char* problem = kDamaged;  // type 3
    if (type == 0) problem = frame.append(content);
    if (type == 1) problem = frame.fill(content[0], bytes);
    if (type == 2) problem = frame.block(content);
    if (problem == nullptr && frame.done() - before > kMaxBlock) problem = kDamaged;
    if (problem != nullptr) return problem;
  }
  if (states_size && frame.done() != size) return "of another size than stated";
  if (has_checksum) {
    const auto hash = static_cast<std::uint32_t>(XXH64(out.data() + done, frame.done(), 0));
    if (in.u32() != hash) return in.ok() ? "damaged (wrong checksum)" : kTruncated;
  }
  done += frame.done();
  return nullptr;
}

}  // namespace

const char* decode_zstd(View frames, std::span<std::uint8_t> out) {
  ByteReader in(frames);
  std::size_t done = 0;
  while (in.left() > 0) {
    const std::uint32_t magic = in.u32();
    if (in.ok() && (magic & ~15u) == kSkippableMagic) {
      in.bytes(in.u32());
    } else if (magic == kFrameMagic) {
      if (const char* problem = decode_frame(in, out, done)) return problem;
    } else {
      return "not a zstd frame";
    }
    if (!in.ok()) return kTruncated;
  }
  return done == out.size() ? nullptr : "too short";
}

}  // namespace stgs::web
