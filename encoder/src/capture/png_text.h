// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace stgs::encoder {

// Removes the texts and the colour profile of a PNG image, which nothing uses. libpng would inflate
// and keep each of up to 1000 of them, which take 8 MB in 8 KB. Other files stay as they are.
void remove_png_text(std::vector<std::uint8_t>& bytes);
// Returns whether a frame of a video is a PNG or MNG image with more than 64 KiB of texts and
// colour profiles, which FFmpeg would inflate to 1000 times as many bytes.
bool has_long_png_text(std::span<const std::uint8_t> frame);

}  // namespace stgs::encoder
