// SPDX-License-Identifier: Apache-2.0
// Little-endian fields in memory (spec 1.3).
#pragma once

#include <bit>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stgs {

// Appends little-endian fields to a buffer.
class ByteWriter {
 public:
  void u8(std::uint8_t v) { out_.push_back(v); }
  void u16(std::uint16_t v) { put(v, 2); }
  void u32(std::uint32_t v) { put(v, 4); }
  void u64(std::uint64_t v) { put(v, 8); }
  void f32(float v) { u32(std::bit_cast<std::uint32_t>(v)); }
  void f64(double v) { u64(std::bit_cast<std::uint64_t>(v)); }
  // 7 bits per byte, lowest first; bit 7 is set if more bytes follow (spec 1.4).
  void varint(std::uint64_t v) {
    for (; v >= 0x80; v >>= 7) u8(static_cast<std::uint8_t>(v | 0x80));
    u8(static_cast<std::uint8_t>(v));
  }
  void bytes(std::span<const std::uint8_t> v) { out_.insert(out_.end(), v.begin(), v.end()); }
  // A u32 length, then the bytes.
  void string(std::string_view v) {
    u32(static_cast<std::uint32_t>(v.size()));
    out_.insert(out_.end(), v.begin(), v.end());
  }

  std::size_t size() const { return out_.size(); }
  std::span<const std::uint8_t> view() const { return out_; }
  std::vector<std::uint8_t> take() { return std::move(out_); }

 private:
  void put(std::uint64_t v, int count) {
    for (int i = 0; i < count; ++i) out_.push_back(static_cast<std::uint8_t>(v >> (8 * i)));
  }
  std::vector<std::uint8_t> out_;
};

// Reads little-endian fields from a buffer. Past the end, or after an invalid varint, it returns
// zeros, and ok() stays false.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  std::uint8_t u8() { return static_cast<std::uint8_t>(get(1)); }
  int i8() { return std::bit_cast<std::int8_t>(u8()); }
  std::uint16_t u16() { return static_cast<std::uint16_t>(get(2)); }
  std::uint32_t u32() { return static_cast<std::uint32_t>(get(4)); }
  std::uint64_t u64() { return get(8); }
  float f32() { return std::bit_cast<float>(u32()); }
  double f64() { return std::bit_cast<double>(u64()); }
  std::uint64_t varint() {
    if (at_ < bytes_.size() && bytes_[at_] < 0x80 && ok_) return bytes_[at_++];
    std::uint64_t v = 0;
    for (int shift = 0; shift < 64; shift += 7) {
      const std::uint8_t byte = u8();
      v |= std::uint64_t{byte & 0x7Fu} << shift;
      if ((byte & 0x80) != 0) continue;
      // Only the shortest form, of at most 64 bits, is valid: each number has one encoding.
      ok_ = ok_ && (shift == 0 || byte != 0) && (shift < 63 || byte == 1);
      return ok_ ? v : 0;
    }
    ok_ = false;
    return 0;
  }
  // Skips numbers, which may be invalid.
  void skip_varints(std::uint64_t count) {
    for (; count > 0 && at_ < bytes_.size(); ++at_) count -= bytes_[at_] < 0x80 ? 1 : 0;
    ok_ = ok_ && count == 0;
  }
  std::span<const std::uint8_t> bytes(std::uint64_t count) {
    if (!ok_ || count > bytes_.size() - at_) {
      ok_ = false;
      return {};
    }
    const auto out = bytes_.subspan(at_, static_cast<std::size_t>(count));
    at_ += static_cast<std::size_t>(count);
    return out;
  }
  std::string string() {
    const auto text = bytes(u32());
    return {text.begin(), text.end()};
  }

  bool ok() const { return ok_; }
  std::size_t position() const { return at_; }
  std::size_t left() const { return bytes_.size() - at_; }

 private:
  std::uint64_t get(int count) {
    std::uint64_t v = 0;
    const auto field = bytes(static_cast<std::uint64_t>(count));
    for (std::size_t i = 0; i < field.size(); ++i) v |= std::uint64_t{field[i]} << (8 * i);
    return v;
  }
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  bool ok_ = true;
};

}  // namespace stgs
