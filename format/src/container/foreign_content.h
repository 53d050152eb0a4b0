// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace stgs {

// Number of bytes at the beginning of a file that are enough for describe_foreign_content().
inline constexpr std::size_t kForeignBytes = 4096;

// Names the content of a file that is no .stgs file, with advice, for messages: "this is a PLY
// file; convert models with 'stgs convert'". `head` holds the file's first bytes; text is
// recognised by all of them. Returns "" for unknown content.
std::string describe_foreign_content(std::span<const std::uint8_t> head);

}  // namespace stgs
