// SPDX-License-Identifier: Apache-2.0
#include "mutator.h"

#include <algorithm>
#include <array>

namespace stgs::fuzz {
namespace {

// Values at which counts and sizes fail: 0, sign changes, and overflow of sums and products.
constexpr std::array<std::uint64_t, 22> kNumbers = {0,
                                                    1,
                                                    2,
                                                    3,
                                                    7,
                                                    8,
                                                    16,
                                                    31,
                                                    32,
                                                    64,
                                                    127,
                                                    128,
                                                    255,
                                                    256,
                                                    32767,
                                                    65535,
                                                    0x7FFFFFFF,
                                                    0xFFFFFFFF,
                                                    0x100000000,
                                                    0x3FFFFFFFFFFFFFFF,
                                                    0x7FFFFFFFFFFFFFFF,
                                                    0xFFFFFFFFFFFFFFFF};

std::ptrdiff_t at(std::size_t offset) {
  return static_cast<std::ptrdiff_t>(offset);
}

class Mutation {
 public:
  Mutation(Bytes& bytes, View other, const std::vector<Unit>& units, Random& random)
      : bytes_(bytes), other_(other), units_(units), random_(random) {}

  // Returns whether the size changed.
  bool apply() {
    const std::size_t size = bytes_.size();
    switch (random_.below(12)) {
      case 0:
      case 1:
        flip_bit();
        break;
      case 2:
        if (size > 0) bytes_[random_offset()] = static_cast<std::uint8_t>(random_.next());
        break;
      case 3:
      case 4:
      case 5:
        set_number();
        break;
      case 6:
        add_number();
        break;
      case 7:
        bytes_.resize(random_.below(size + 1));
        break;
      case 8:
        erase();
        break;
      case 9:
        insert();
        break;
      case 10:
        splice();
        break;
      default:
        move_units();
    }
    return bytes_.size() != size;
  }

 private:
  // A random offset, mostly near the beginning of a unit, which holds its counts and sizes.
  std::size_t random_offset() {
    if (units_.empty() || random_.one_in(3)) return random_.below(bytes_.size());
    const Unit unit = units_[random_.below(units_.size())];
    const std::size_t length = unit.end - unit.begin;
    const std::size_t reach = random_.one_in(2) ? std::min<std::size_t>(length, 48) : length;
    return std::min(unit.begin + random_.below(reach), bytes_.size() - 1);
  }

  void flip_bit() {
    if (!bytes_.empty())
      bytes_[random_offset()] ^= static_cast<std::uint8_t>(1u << random_.below(8));
  }

  void put(std::size_t offset, std::uint64_t value, std::size_t width) {
    for (std::size_t i = 0; i < width && offset + i < bytes_.size(); ++i) {
      bytes_[offset + i] = static_cast<std::uint8_t>(value >> (8 * i));
    }
  }

  void set_number() {
    if (bytes_.empty()) return;
    const std::size_t width = std::size_t{1} << random_.below(4);
    std::uint64_t value = kNumbers[random_.below(kNumbers.size())];
    if (random_.one_in(4)) value = bytes_.size() + random_.below(5) - 2;
    put(random_offset(), value, width);
  }

  void add_number() {
    if (bytes_.empty()) return;
    const std::size_t offset = random_offset(), width = std::size_t{1} << random_.below(4);
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < width && offset + i < bytes_.size(); ++i) {
      value |= std::uint64_t{bytes_[offset + i]} << (8 * i);
    }
    put(offset, value + random_.below(17) - 8, width);
  }

  void erase() {
    if (bytes_.empty()) return;
    const std::size_t begin = random_offset();
    const std::size_t count = 1 + random_.below(std::min<std::size_t>(64, bytes_.size() - begin));
    bytes_.erase(bytes_.begin() + at(begin), bytes_.begin() + at(begin + count));
  }

  void insert() {
    Bytes extra(1 + random_.below(32));
    const bool noise = random_.one_in(2);
    for (std::uint8_t& byte : extra) byte = noise ? static_cast<std::uint8_t>(random_.next()) : 0;
    bytes_.insert(bytes_.begin() + at(random_.below(bytes_.size() + 1)), extra.begin(),
                  extra.end());
  }

  // Inserts bytes of the other input, or overwrites with them.
  void splice() {
    if (other_.empty()) return;
    const std::size_t from = random_.below(other_.size());
    const View bytes =
        other_.subspan(from, 1 + random_.below(std::min<std::size_t>(256, other_.size() - from)));
    const std::size_t to = random_.below(bytes_.size() + 1);
    const std::size_t overwritten =
        random_.one_in(2) ? 0 : std::min(bytes.size(), bytes_.size() - to);
    bytes_.erase(bytes_.begin() + at(to), bytes_.begin() + at(to + overwritten));
    bytes_.insert(bytes_.begin() + at(to), bytes.begin(), bytes.end());
  }

  // Removes a unit, repeats it, or swaps two. The units are those of the unchanged bytes.
  void move_units() {
    if (units_.empty()) return;
    const Unit a = units_[random_.below(units_.size())], b = units_[random_.below(units_.size())];
    if (a.end > bytes_.size() || b.end > bytes_.size()) return;
    const Bytes copy(bytes_.begin() + at(a.begin), bytes_.begin() + at(a.end));
    switch (random_.below(3)) {
      case 0:
        bytes_.erase(bytes_.begin() + at(a.begin), bytes_.begin() + at(a.end));
        break;
      case 1:
        bytes_.insert(bytes_.begin() + at(b.end), copy.begin(), copy.end());
        break;
      default:
        const Unit first = a.begin < b.begin ? a : b, second = a.begin < b.begin ? b : a;
        if (second.begin < first.end) return;  // identical or nested
        std::rotate(bytes_.begin() + at(first.begin), bytes_.begin() + at(first.end),
                    bytes_.begin() + at(second.end));
    }
  }

  Bytes& bytes_;
  View other_;
  const std::vector<Unit>& units_;
  Random& random_;
};

}  // namespace

std::uint64_t Random::next() {
  std::uint64_t z = state_ += 0x9E3779B97F4A7C15;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EB;
  return z ^ (z >> 31);
}

Bytes mutate(const Target& target, View base, View other, std::size_t max_bytes, Random& random) {
  // One in eight inputs is damaged in its stored form.
  const bool raw = random.one_in(8);
  const auto unpacked = [&](View input) {
    return raw || target.unpack == nullptr ? Bytes(input.begin(), input.end())
                                           : target.unpack(input);
  };
  Bytes bytes = unpacked(base);
  const Bytes source = unpacked(other);
  const std::vector<Unit> units =
      raw || target.units == nullptr ? std::vector<Unit>{} : target.units(bytes);
  bool resized = false;
  const std::size_t changes = 1 + random.below(4);
  for (std::size_t i = 0; i < changes; ++i) {
    resized = Mutation(bytes, source, units, random).apply() || resized;
  }
  if (!raw && target.repack != nullptr) {
    // Resized inputs are mostly repaired completely, since otherwise the first size check rejects
    // them.
    const std::size_t choice = random.below(8);
    const Repair repair = choice == 0                              ? Repair::kNothing
                          : choice == 1 || (choice > 4 && resized) ? Repair::kSizes
                                                                   : Repair::kChecksums;
    bytes = target.repack(std::move(bytes), repair);
  }
  if (bytes.size() > max_bytes) bytes.resize(max_bytes);
  return bytes;
}

}  // namespace stgs::fuzz
