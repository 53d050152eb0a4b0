// SPDX-License-Identifier: Apache-2.0
// Reading what a person types: sizes, ranges, colours, numbers in a range, and near misses.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "stgs/format/status.h"

namespace stgs::tools {

struct Size {
  int width = 0, height = 0;  // pixels
};
struct FrameRange {
  int begin = 0, end = 0;  // [begin, end)
};

// "1280x720"; each side 1 to 32768.
Result<Size> parse_size(const std::string& text);
// "A:B", "A:" (to the end) or ":B", as [A, B); `total` frames bound it.
Result<FrameRange> parse_frames(const std::string& text, int total);
// The same where the end is not known yet: an open end is -1.
Result<FrameRange> parse_open_frames(const std::string& text);
// "r,g,b", each 0 to 1.
Result<std::vector<float>> parse_colour(const std::string& text);
// "a,b,c" -> {a, b, c}; empty parts are left out.
std::vector<std::string> split_list(const std::string& text);

// "512M", "8G", "1.5T": bytes, a whole number without a letter; K, M, G and T are powers of 1024.
// At least 1.
Result<std::uint64_t> parse_bytes(const std::string& text);

// A CLI11 validator function: empty if `text` is a finite number in [low, high], else the reason.
std::function<std::string(const std::string&)> number_between(double low, double high);

// The same for a whole number from 0 to 2^64 - 1.
std::string check_whole_number(const std::string& text);

// The candidate nearest to `word` in edits, if near enough to be meant; else "".
std::string nearest_word(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace stgs::tools
