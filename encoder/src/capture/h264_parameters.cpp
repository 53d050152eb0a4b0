// SPDX-License-Identifier: Apache-2.0
#include "h264_parameters.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace stgs::encoder {
namespace {

// The profiles whose sequence parameter sets state the chroma format (ITU-T H.264, 7.3.2.1.1).
constexpr std::array kProfilesWithChroma = {100, 110, 122, 244, 44,  83, 86,
                                            118, 128, 138, 139, 134, 135};
constexpr int kSequenceParameters = 7;  // nal_unit_type
constexpr std::size_t kAvcHeader = 6;   // bytes of avcC before the first length
constexpr std::size_t kFixedBytes = 4;  // of a set: header, profile, constraints, level

class Bits {
 public:
  explicit Bits(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  // Reads an Exp-Golomb code; 0 beyond the end.
  unsigned read_code() {
    int zeros = 0;
    while (zeros < 16 && at_ < 8 * bytes_.size() && bit() == 0) ++zeros;
    unsigned value = 1;
    for (int i = 0; i < zeros; ++i) value = 2 * value + bit();
    return value - 1;
  }

 private:
  unsigned bit() {
    if (at_ >= 8 * bytes_.size()) return 0;
    const unsigned out = bytes_[at_ / 8] >> (7 - at_ % 8) & 1;
    ++at_;
    return out;
  }
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
};

using Bytes = std::span<const std::uint8_t>;

bool is_avcc(Bytes parameters) {
  return parameters.size() >= kAvcHeader && parameters[0] == 1;
}

// Returns whether a unit is a sequence parameter set of frames without chroma.
bool is_grey_unit(Bytes unit) {
  if (unit.size() <= kFixedBytes || (unit[0] & 31) != kSequenceParameters) return false;
  if (std::find(kProfilesWithChroma.begin(), kProfilesWithChroma.end(), unit[1]) ==
      kProfilesWithChroma.end())
    return false;
  Bits bits(unit.subspan(kFixedBytes));
  bits.read_code();  // seq_parameter_set_id
  constexpr unsigned kMonochrome = 0;
  return bits.read_code() == kMonochrome;
}

// Of the first units, which each follow their length.
bool has_grey_length(Bytes bytes, std::size_t length_bytes, std::size_t max_units) {
  for (; max_units > 0 && bytes.size() > length_bytes; --max_units) {
    std::size_t length = 0;
    for (std::size_t i = 0; i < length_bytes; ++i) length = length << 8 | bytes[i];
    bytes = bytes.subspan(length_bytes);
    if (is_grey_unit(bytes.first(std::min(length, bytes.size())))) return true;
    bytes = bytes.subspan(std::min(length, bytes.size()));
  }
  return false;
}

// Of units that each follow a start code.
bool has_grey_start(Bytes bytes) {
  constexpr std::array<std::uint8_t, 3> kStartCode = {0, 0, 1};
  auto at = bytes.begin();
  while (true) {
    at = std::search(at, bytes.end(), kStartCode.begin(), kStartCode.end());
    if (at == bytes.end()) return false;
    at += kStartCode.size();
    if (is_grey_unit({at, bytes.end()})) return true;
  }
}

}  // namespace

bool is_grey_h264(Bytes parameters) {
  if (!is_avcc(parameters)) return has_grey_start(parameters);
  constexpr std::size_t kLengthBytes = 2;
  const std::size_t sets = parameters[5] & 31;
  return has_grey_length(parameters.subspan(kAvcHeader), kLengthBytes, sets);
}

bool is_grey_h264_packet(Bytes parameters, Bytes packet) {
  if (!is_avcc(parameters)) return has_grey_start(packet);
  const std::size_t length_bytes = (parameters[4] & 3) + std::size_t{1};
  return has_grey_length(packet, length_bytes, packet.size());
}

}  // namespace stgs::encoder
