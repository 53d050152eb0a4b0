// SPDX-License-Identifier: Apache-2.0
// Names the content of files that are no .stgs files, where the format library does not: it knows
// images, videos and models by their magic bytes.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace stgs::tools {

// Number of bytes that describe_content() looks at.
inline constexpr std::size_t kContentBytes = 4096;

// Returns a description of foreign content, with advice: "this is a JSON file". Returns "" for
// .stgs files, empty files and unknown content.
std::string describe_content(std::span<const std::uint8_t> head);

}  // namespace stgs::tools
