// SPDX-License-Identifier: Apache-2.0
// Decodes Zstandard (RFC 8878), for the import module, which has no libzstd.
#pragma once

#include <cstdint>
#include <span>

namespace stgs::web {

// Decodes frames without a dictionary, which hold exactly `out`. Returns null, or what is wrong
// with them.
const char* decode_zstd(std::span<const std::uint8_t> frames, std::span<std::uint8_t> out);

}  // namespace stgs::web
