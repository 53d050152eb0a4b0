// SPDX-License-Identifier: Apache-2.0
#include "frame_numbers.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>

#include "capture_files.h"

namespace stgs::encoder {
namespace {

using Numbers = std::vector<std::uint64_t>;

constexpr std::size_t kMaxDigits = 18;  // fit in 64 bits

std::string folder_of(const std::string& path) {
  return std::filesystem::path(path).parent_path().string();
}

std::optional<std::uint64_t> number_of(const std::string& path) {
  const std::string stem = stem_of(path);
  const std::size_t last = stem.find_last_not_of("0123456789");
  const std::string digits = last == std::string::npos ? stem : stem.substr(last + 1);
  if (digits.empty() || digits.size() > kMaxDigits) return std::nullopt;
  return std::stoull(digits);
}

// Returns the strictly increasing numbers of the first `count` files. Empty if no name ends in a
// number.
Result<Numbers> numbers_of(const std::vector<std::string>& paths, std::size_t count,
                           const std::string& camera) {
  Numbers numbers;
  for (std::size_t i = 0; i < std::min(count, paths.size()); ++i) {
    const std::optional<std::uint64_t> number = number_of(paths[i]);
    if (number.has_value() != number_of(paths[0]).has_value()) {
      return invalid_file(
          "{}: camera '{}' mixes file names with and without a frame number at the end; name all "
          "files in one way",
          paths[i], camera);
    }
    if (!number) continue;
    if (!numbers.empty() && *number <= numbers.back()) {
      return invalid_file(
          "{}: camera '{}': the frame number does not increase after {}; keep one file per frame, "
          "named by the frame number",
          paths[i], camera, paths[i - 1]);
    }
    numbers.push_back(*number);
  }
  return numbers;
}

std::uint64_t smallest_step(const Numbers& numbers, std::uint64_t step) {
  for (std::size_t i = 1; i < numbers.size(); ++i) {
    step = std::min(step, numbers[i] - numbers[i - 1]);
  }
  return step;
}

// Checks that the numbers are `first`, `first` + `step`, and so on. `what` is "image" or "mask".
Status check_sequence(const Numbers& numbers, std::uint64_t first, std::uint64_t step,
                      const std::string& folder, const std::string& camera, const char* what) {
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const std::uint64_t expected = first + i * step;
    if (numbers[i] == expected) continue;
    return invalid_file(
        "{}: camera '{}' has no {} of frame {} (the next is frame {}); add the missing files, or "
        "renumber the frames without gaps and identically for all cameras",
        folder, camera, what, expected, numbers[i]);
  }
  return {};
}

}  // namespace

Status check_frame_numbers(const SourceCapture& source, int end, const LogSink& log) {
  constexpr std::uint64_t kUnknown = std::numeric_limits<std::uint64_t>::max();
  // Stated times replace equal numbers: then each camera counts for itself.
  const bool alone = source.has_timing;
  const auto count = end < 0 || alone ? std::numeric_limits<std::size_t>::max() : std::size_t(end);
  std::vector<Numbers> all;
  std::uint64_t first = kUnknown, step = kUnknown;
  for (const SourceCamera& camera : source.cameras) {
    all.emplace_back();
    if (!camera.numbered) continue;
    STGS_ASSIGN(all.back(), numbers_of(camera.images, count, camera.name));
    if (all.back().empty()) {
      log(1,
          fmt::format("{}: no frame number at the end of the names; using the order of the names",
                      folder_of(camera.images.front())));
      continue;
    }
    first = std::min(first, all.back().front());
    step = smallest_step(all.back(), step);
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].empty()) continue;
    const SourceCamera& camera = source.cameras[i];
    if (alone) {
      first = all[i].front();
      step = smallest_step(all[i], kUnknown);
    }
    STGS_TRY(check_sequence(all[i], first, step, folder_of(camera.images.front()), camera.name,
                            "image"));
  }
  return {};
}

Status check_mask_numbers(const SourceCamera& camera) {
  STGS_ASSIGN(const Numbers numbers, numbers_of(camera.masks, camera.masks.size(), camera.name));
  if (numbers.empty()) return {};
  return check_sequence(numbers, std::min<std::uint64_t>(numbers.front(), 1), 1,
                        folder_of(camera.masks.front()), camera.name, "mask");
}

}  // namespace stgs::encoder
