// SPDX-License-Identifier: Apache-2.0
#include "options.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>

#include "parameter_options.h"
#include "stgs/format/camera.h"

namespace stgs::tools {
namespace {

// Parses the entire text as an integer.
bool read_int(std::string_view text, int& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size();
}

// Parses the entire text as a finite number.
bool read_number(const std::string& text, double& value) {
  if (text.empty() || std::isspace(static_cast<unsigned char>(text[0])) != 0) return false;
  char* end = nullptr;
  value = std::strtod(text.c_str(), &end);
  return *end == '\0' && std::isfinite(value);
}

// Returns the Levenshtein distance.
std::size_t edits(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, replaced});
    }
  }
  return row[b.size()];
}

}  // namespace

Result<Size> parse_size(const std::string& text) {
  const std::size_t cross = text.find('x');
  Size size;
  const bool read = cross != std::string::npos &&
                    read_int(std::string_view(text).substr(0, cross), size.width) &&
                    read_int(std::string_view(text).substr(cross + 1), size.height);
  const auto side = [](int v) { return v >= 1 && v <= kMaxImageSide; };
  if (!read || !side(size.width) || !side(size.height)) {
    return usage_error(
        "'{}' is not a size; expected WIDTHxHEIGHT in pixels, each 1 to {}, for example 1280x720",
        text, kMaxImageSide);
  }
  return size;
}

Result<std::uint64_t> parse_bytes(const std::string& text) {
  constexpr std::string_view kUnits = "KMGT";
  const std::size_t unit = text.empty() ? std::string_view::npos : kUnits.find(text.back());
  const bool has_no_unit = unit == std::string_view::npos;
  double number = 0;
  const bool read = read_number(has_no_unit ? text : text.substr(0, text.size() - 1), number);
  const double bytes = has_no_unit ? number : std::ldexp(number, 10 * static_cast<int>(unit + 1));
  if (!read || !(bytes >= 1.0) || bytes >= 0x1p63) {
    return usage_error("'{}' is not a size in bytes; expected for example 512M or 8G", text);
  }
  return static_cast<std::uint64_t>(bytes);
}

Result<std::uint64_t> parse_memory(const std::string& text) {
  constexpr std::uint64_t kMin = std::uint64_t{1} << 20;
  STGS_ASSIGN(const std::uint64_t bytes, parse_bytes(text));
  if (bytes < kMin) return usage_error("{} is too small; expected at least 1M", text);
  return bytes;
}

Result<FrameRange> parse_open_frames(const std::string& text) {
  const std::size_t colon = text.find(':');
  FrameRange range{0, -1};
  bool read = colon != std::string::npos;
  if (read && colon > 0) read = read_int(std::string_view(text).substr(0, colon), range.begin);
  if (read && colon + 1 < text.size()) {
    read = read_int(std::string_view(text).substr(colon + 1), range.end) && range.end >= 0;
  }
  if (!read || range.begin < 0) {
    return usage_error(
        "'{}' is not a frame range; expected FIRST:END, for example 0:30 for frames 0 to 29", text);
  }
  if (range.end >= 0 && range.end <= range.begin) {
    return usage_error("{} is empty; END must be greater than FIRST", text);
  }
  return range;
}

Result<FrameRange> parse_frames(const std::string& text, int total) {
  STGS_ASSIGN(FrameRange range, parse_open_frames(text));
  if (range.end < 0) range.end = total;
  if (range.begin >= total || range.end > total) {
    return usage_error("--frames {} is out of range; the clip has {}, 0:{}", text,
                       total == 1 ? "1 frame" : fmt::format("{} frames", total), total);
  }
  return range;
}

Result<std::vector<float>> parse_colour(const std::string& text) {
  std::vector<float> colour;
  for (const std::string& part : split_list(text)) {
    double value = 0;
    if (!read_number(part, value) || value < 0 || value > 1) break;
    colour.push_back(static_cast<float>(value));
  }
  if (colour.size() != 3 || std::count(text.begin(), text.end(), ',') != 2) {
    return usage_error("'{}' is not a colour; expected r,g,b, each from 0 to 1, for example 1,1,1",
                       text);
  }
  return colour;
}

std::vector<std::string> split_list(const std::string& text) {
  std::vector<std::string> parts;
  std::size_t from = 0;
  while (from <= text.size()) {
    const std::size_t comma = std::min(text.find(',', from), text.size());
    if (comma > from) parts.push_back(text.substr(from, comma - from));
    from = comma + 1;
  }
  return parts;
}

std::function<std::string(const std::string&)> number_between(double low, double high) {
  return [low, high](const std::string& text) -> std::string {
    double value = 0;
    if (!read_number(text, value)) return fmt::format("'{}' is not a number", text);
    if (value < low || value > high) {
      return fmt::format("{} is out of range; expected {} to {}", text, low, high);
    }
    return {};
  };
}

std::string option_help(const Parameter& parameter) {
  std::string help = parameter.help;
  if (*parameter.unit != '\0') help += fmt::format(", {}", parameter.unit);
  if (parameter.zero != nullptr) help += fmt::format(" (default: {})", parameter.zero);
  return help;
}

std::string check_integer(const std::string& text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool read = error == std::errc() && end == text.data() + text.size();
  return read ? "" : fmt::format("'{}' is not an integer from 0 to 2^64 - 1", text);
}

std::string nearest_word(const std::string& word, const std::vector<std::string>& candidates) {
  std::string best;
  std::size_t best_edits = std::max<std::size_t>(2, word.size() / 3) + 1;
  for (const std::string& candidate : candidates) {
    const std::size_t distance = edits(word, candidate);
    if (distance < best_edits) {
      best_edits = distance;
      best = candidate;
    }
  }
  return best;
}

}  // namespace stgs::tools
