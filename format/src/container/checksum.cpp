// SPDX-License-Identifier: Apache-2.0
#include <libdeflate.h>

#include "container/container.h"

namespace stgs {

std::uint32_t checksum(std::span<const std::uint8_t> bytes, std::uint32_t before) {
  return libdeflate_crc32(before, bytes.data(), bytes.size());
}

}  // namespace stgs
