// SPDX-License-Identifier: Apache-2.0
// Replaces draco_points.cpp in builds without libdraco. Callers check check_draco() first.
#include <stdexcept>

#include "codec/draco_points.h"

namespace stgs {

Status check_draco() {
  return not_built(
      "this build lacks libdraco, which the profile draco needs; install libdraco-dev and rebuild, "
      "or use the profile quantised");
}

std::vector<std::uint8_t> draco_encode(std::span<const std::uint8_t>, std::size_t, int) {
  throw std::runtime_error(check_draco().message());
}

bool draco_fits(std::span<const std::uint8_t>, std::size_t) {
  return false;
}

const char* draco_decode(std::span<const std::uint8_t>, std::size_t, std::span<std::uint8_t>) {
  return "this build lacks libdraco";
}

}  // namespace stgs
