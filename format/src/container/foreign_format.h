// SPDX-License-Identifier: Apache-2.0
// Names the content of files that are no .stgs files, for messages.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace stgs {

// Number of bytes that foreign_format() looks at.
inline constexpr std::size_t kForeignBytes = 4096;

// Describes the content of a file without the magic bytes, with advice: "this is a JSON file".
// Returns "" if the content is not known.
std::string foreign_format(std::span<const std::uint8_t> head);

}  // namespace stgs
