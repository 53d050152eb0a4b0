// SPDX-License-Identifier: Apache-2.0
// CRC-32 (spec 1.5) for WebAssembly, which libdeflate is not built for: 16 bytes at a time, with a
// table for each. The tables are made at the start: they are half of their size in the module.
#include <array>
#include <cstdint>
#include <cstring>

#include "container/container.h"

namespace stgs {
namespace {

constexpr std::size_t kStep = 16;  // bytes
using Tables = std::array<std::array<std::uint32_t, 256>, kStep>;

Tables make_tables() {
  Tables tables{};
  for (std::uint32_t byte = 0; byte < 256; ++byte) {
    std::uint32_t crc = byte;
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ ((crc & 1) != 0 ? 0xEDB88320u : 0u);
    tables[0][byte] = crc;
  }
  for (std::size_t k = 1; k < kStep; ++k) {
    for (std::size_t byte = 0; byte < 256; ++byte) {
      const std::uint32_t before = tables[k - 1][byte];
      tables[k][byte] = before >> 8 ^ tables[0][before & 0xFF];
    }
  }
  return tables;
}

const Tables kTables = make_tables();

}  // namespace

std::uint32_t checksum(std::span<const std::uint8_t> bytes, std::uint32_t before) {
  std::uint32_t crc = ~before;
  std::size_t at = 0;
  for (; at + kStep <= bytes.size(); at += kStep) {
    std::uint32_t words[4];
    std::memcpy(words, &bytes[at], kStep);
    words[0] ^= crc;
    crc = 0;
    for (std::size_t w = 0; w < 4; ++w) {
      for (std::size_t b = 0; b < 4; ++b)
        crc ^= kTables[kStep - 1 - 4 * w - b][words[w] >> 8 * b & 0xFF];
    }
  }
  for (; at < bytes.size(); ++at) crc = crc >> 8 ^ kTables[0][(crc ^ bytes[at]) & 0xFF];
  return ~crc;
}

}  // namespace stgs
