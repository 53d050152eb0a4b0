// SPDX-License-Identifier: Apache-2.0
// Parsers of option values: sizes, ranges, colours, numbers; and the nearest known word.
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

// Parses "1280x720"; each side 1 to 32768.
Result<Size> parse_size(const std::string& text);
// Parses "A:B", "A:" (to the end) or ":B", the value of --frames, as [A, B), within [0, total).
Result<FrameRange> parse_frames(const std::string& text, int total);
// As parse_frames, before the number of frames is known: an open end is -1.
Result<FrameRange> parse_open_frames(const std::string& text);
// Parses "r,g,b", each 0 to 1.
Result<std::vector<float>> parse_colour(const std::string& text);
// Splits "a,b,c" into {a, b, c}; drops empty parts.
std::vector<std::string> split_list(const std::string& text);

// Parses "512M", "8G" or "1.5T" as bytes. K, M, G and T are powers of 1024; without a letter the
// unit is one byte. At least 1.
Result<std::uint64_t> parse_bytes(const std::string& text);

// As parse_bytes, for the memory of a scene: at least 1M, which the library requires.
Result<std::uint64_t> parse_memory(const std::string& text);

// A CLI11 validator: returns "" if `parse` accepts the text, and its message otherwise.
template <auto parse>
std::string accepted_by(const std::string& text) {
  return parse(text).status().message();
}

// Returns a CLI11 validator: it returns "" if its argument is a finite number in [low, high], and
// the reason otherwise.
std::function<std::string(const std::string&)> number_between(double low, double high);

// A CLI11 validator for integers from 0 to 2^64 - 1.
std::string check_integer(const std::string& text);

// Returns the candidate with the fewest edits from `word`, or "" if none is close.
std::string nearest_word(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace stgs::tools
