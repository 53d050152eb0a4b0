// SPDX-License-Identifier: Apache-2.0
// In the place of draco_points.cpp where libdraco is not there. Who wants a coder asks
// check_draco() first.
#include <stdexcept>

#include "draco_points.h"

namespace stgs {

Status check_draco() {
  return not_built(
      "positions of the profile draco need libdraco, which this build does not have: install "
      "libdraco-dev and build again, or pack with the profile quantised");
}

std::vector<std::uint8_t> draco_encode(std::span<const std::uint8_t>, std::size_t, int) {
  throw std::runtime_error(check_draco().message());
}

bool draco_fits(std::span<const std::uint8_t>, std::size_t) {
  return false;
}

const char* draco_decode(std::span<const std::uint8_t>, std::size_t, std::span<std::uint8_t>) {
  return "this build has no libdraco";
}

}  // namespace stgs
