// SPDX-License-Identifier: Apache-2.0
// Bytes of the caller's as a ByteSource.
#pragma once

#include <memory>
#include <span>

#include "stgs/format/byte_source.h"
#include "stgs/stgs.h"

namespace stgs::sdk {

// The bytes are not copied.
std::unique_ptr<ByteSource> borrowed_source(std::span<const std::uint8_t> bytes);
// Calls io.close when it ends.
std::unique_ptr<ByteSource> callback_source(const stgs_io& io);

}  // namespace stgs::sdk
