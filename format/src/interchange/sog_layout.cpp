// SPDX-License-Identifier: Apache-2.0
#include "interchange/sog_layout.h"

#include <algorithm>

#include "interchange/json_fields.h"

namespace stgs {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxCodebook = 256;       // one entry per byte value
constexpr std::uint64_t kMaxPalette = 1 << 16;  // entries, addressed by labels of 16 bits

Result<SogPalette> palette_of(const json& property, CodebookRule rule, const std::string& label) {
  SogPalette palette;
  STGS_ASSIGN(const std::uint64_t bands,
              sog_integer(member(property, "bands"), 1, 3, label + ".bands"));
  STGS_ASSIGN(const std::uint64_t entries,
              sog_integer(member(property, "count"), 1, kMaxPalette, label + ".count"));
  palette.bands = static_cast<int>(bands);
  palette.entries = static_cast<std::size_t>(entries);
  STGS_ASSIGN(palette.codebook, sog_codebook(property, rule, label));
  STGS_ASSIGN(const std::vector<std::string> names, sog_files(property, 2, label));
  palette.centroids = names[0];
  palette.labels = names[1];
  return palette;
}

}  // namespace

Result<std::vector<std::string>> sog_files(const json& property, std::size_t count,
                                           const std::string& label) {
  return sog_files_of(member(property, "files"), count, label);
}

Result<std::vector<std::string>> sog_files_of(const json& files, std::size_t count,
                                              const std::string& label) {
  if (!files.is_array() || files.size() != count) {
    return invalid_file("{}.files: expected a list of {} file names", label, count);
  }
  std::vector<std::string> out;
  for (const json& name : files) {
    if (!name.is_string()) return invalid_file("{}.files: expected file names", label);
    const auto& text = name.get_ref<const std::string&>();
    if (text.size() > kMaxSogNameBytes) {
      return invalid_file("{}.files: file name too long (at most {} bytes allowed, got {})", label,
                          kMaxSogNameBytes, text.size());
    }
    out.push_back(text);
  }
  return out;
}

Result<Codebook> sog_codebook(const json& property, CodebookRule rule, const std::string& label) {
  const json& list = member(property, "codebook");
  std::size_t size = kMaxCodebook;
  if (rule == CodebookRule::kShort) {
    size = list.size();
    if (!list.is_array() || size < 1 || size > kMaxCodebook) {
      return invalid_file("{}.codebook: expected a list of 1 to {} numbers", label, kMaxCodebook);
    }
  }
  json completed;
  if (rule == CodebookRule::kMissingFirst && list.is_array() && list.size() == kMaxCodebook &&
      list[0].is_null() && list[1].is_number() && list[255].is_number()) {
    // It lies on the line through entries 1 and 255.
    const double second = list[1].get<double>();
    completed = list;
    completed[0] = second + (second - list[255].get<double>()) / 255;
  }
  STGS_ASSIGN(const std::vector<double> values,
              number_list(completed.is_null() ? list : completed, size, label + ".codebook"));
  Codebook out;
  std::transform(values.begin(), values.end(), std::back_inserter(out),
                 [](double v) { return static_cast<float>(v); });
  return out;
}

Result<SogRange> sog_range(const json& property, std::size_t files, const std::string& label) {
  return sog_range_of(member(property, "mins"), member(property, "maxs"), member(property, "files"),
                      files, label);
}

Result<SogRange> sog_range_of(const json& mins, const json& maxs, const json& files,
                              std::size_t count, const std::string& label) {
  SogRange range;
  STGS_ASSIGN(const auto low, number_list(mins, 3, label + ".mins"));
  STGS_ASSIGN(const auto high, number_list(maxs, 3, label + ".maxs"));
  std::copy_n(low.begin(), 3, range.mins.begin());
  std::copy_n(high.begin(), 3, range.maxs.begin());
  STGS_ASSIGN(range.files, sog_files_of(files, count, label));
  return range;
}

Result<double> sog_number(const json& value, const std::string& label) {
  const double number = value.is_number() ? value.get<double>() : NAN;
  if (!std::isfinite(number)) return invalid_file("{}: expected a finite number", label);
  return number;
}

Result<std::uint64_t> sog_integer(const json& value, std::uint64_t min, std::uint64_t max,
                                  const std::string& label) {
  if (!value.is_number_unsigned() || value.get<std::uint64_t>() < min ||
      value.get<std::uint64_t>() > max) {
    return invalid_file("{}: expected a whole number from {} to {}", label, min, max);
  }
  return value.get<std::uint64_t>();
}

Result<SogLayout> sog_layout(const json& root, CodebookRule rule, const std::string& label,
                             const ReadLimits& limits) {
  SogLayout layout;
  const json& count = member(root, "count");
  if (!count.is_number_unsigned()) return invalid_file("{}: count: expected a number >= 0", label);
  if (count.get<std::uint64_t>() > limits.max_primitives) {
    return unsupported("{}: too many splats (at most {} allowed, got {})", label,
                       limits.max_primitives, count.get<std::uint64_t>());
  }
  layout.count = static_cast<std::size_t>(count.get<std::uint64_t>());
  STGS_ASSIGN(layout.means, sog_range(member(root, "means"), 2, label + ": means"));
  const json &scales = member(root, "scales"), &sh0 = member(root, "sh0");
  STGS_ASSIGN(layout.scales, sog_codebook(scales, rule, label + ": scales"));
  STGS_ASSIGN(layout.sh0, sog_codebook(sh0, rule, label + ": sh0"));
  STGS_ASSIGN(const auto scale_files, sog_files(scales, 1, label + ": scales"));
  STGS_ASSIGN(const auto quat_files, sog_files(member(root, "quats"), 1, label + ": quats"));
  STGS_ASSIGN(const auto sh0_files, sog_files(sh0, 1, label + ": sh0"));
  layout.scales_file = scale_files[0];
  layout.quats_file = quat_files[0];
  layout.sh0_file = sh0_files[0];
  if (const json& sh = member(root, "shN"); !sh.is_null()) {
    STGS_ASSIGN(layout.palette, palette_of(sh, rule, label + ": shN"));
  }
  return layout;
}

}  // namespace stgs
