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
constexpr std::size_t kAvcHeader = 8;   // bytes of avcC before the first set
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

// Returns the parameters from the first sequence parameter set on; empty if there is none.
std::span<const std::uint8_t> find_set(std::span<const std::uint8_t> parameters) {
  const auto is_set = [](std::uint8_t header) { return (header & 31) == kSequenceParameters; };
  if (parameters.size() > kAvcHeader && parameters[0] == 1)
    return is_set(parameters[kAvcHeader]) ? parameters.subspan(kAvcHeader)
                                          : std::span<const std::uint8_t>();
  constexpr std::array<std::uint8_t, 3> kStartCode = {0, 0, 1};
  auto at = parameters.begin();
  while (true) {
    at = std::search(at, parameters.end(), kStartCode.begin(), kStartCode.end());
    if (parameters.end() - at < 4) return {};
    at += 3;
    if (is_set(*at)) return {at, parameters.end()};
  }
}

}  // namespace

bool is_grey_h264(std::span<const std::uint8_t> parameters) {
  const auto set = find_set(parameters);
  if (set.size() <= kFixedBytes) return false;
  if (std::find(kProfilesWithChroma.begin(), kProfilesWithChroma.end(), set[1]) ==
      kProfilesWithChroma.end())
    return false;
  Bits bits(set.subspan(kFixedBytes));
  bits.read_code();  // seq_parameter_set_id
  constexpr unsigned kMonochrome = 0;
  return bits.read_code() == kMonochrome;
}

}  // namespace stgs::encoder
