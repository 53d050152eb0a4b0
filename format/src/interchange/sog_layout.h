// SPDX-License-Identifier: Apache-2.0
// The description of a SOG model (meta.json), as far as SOG, .sogst and .tsog share it.
#pragma once

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "stgs/format/interchange.h"

namespace stgs {

using Codebook = std::vector<float>;  // 1 to 256 values, indexed by a byte

// Which codebooks are valid.
enum class CodebookRule {
  kComplete,      // 256 values
  kMissingFirst,  // the same, or null as the first one, as early writers of SOG left it
  kShort,         // 1 to 256 values
};

// Values per axis between bounds, stored as images: 16 bits with the low byte in files[0] and the
// high byte in files[1], or 8 bits with one file.
struct SogRange {
  std::array<double, 3> mins{}, maxs{};
  std::vector<std::string> files;
};

// The palette of the SH above degree 0.
struct SogPalette {
  int bands = 0;            // 1..3
  std::size_t entries = 0;  // 1..65536
  Codebook codebook;
  std::string centroids, labels;  // file names

  std::size_t coefficients() const {
    return static_cast<std::size_t>((bands + 1) * (bands + 1) - 1);
  }
};

struct SogLayout {
  std::size_t count = 0;
  SogRange means;  // signed logarithms of positions
  Codebook scales, sh0;
  std::string scales_file, quats_file, sh0_file;
  std::optional<SogPalette> palette;

  int sh_degree() const { return palette ? palette->bands : 0; }
};

inline constexpr std::uint64_t kMaxSogMetaBytes = 16 << 20;
inline constexpr std::size_t kMaxSogNameBytes = 4096;  // of a file, with its folder

// The functions below take a member of the description, and `label` for messages.

// Returns a list of `count` names of files, the member "files" of a property.
Result<std::vector<std::string>> sog_files_of(const nlohmann::json& files, std::size_t count,
                                              const std::string& label);
Result<std::vector<std::string>> sog_files(const nlohmann::json& property, std::size_t count,
                                           const std::string& label);
// Returns "codebook".
Result<Codebook> sog_codebook(const nlohmann::json& property, CodebookRule rule,
                              const std::string& label);
// Returns the range with these members.
Result<SogRange> sog_range_of(const nlohmann::json& mins, const nlohmann::json& maxs,
                              const nlohmann::json& files, std::size_t count,
                              const std::string& label);
// Returns the range with the members "mins", "maxs" and "files" of a property.
Result<SogRange> sog_range(const nlohmann::json& property, std::size_t files,
                           const std::string& label);
// Returns a finite number.
Result<double> sog_number(const nlohmann::json& value, const std::string& label);
// Returns a whole number in [min, max]; kInvalidFile otherwise.
Result<std::uint64_t> sog_integer(const nlohmann::json& value, std::uint64_t min, std::uint64_t max,
                                  const std::string& label);

// Returns the shared members of a complete description. kUnsupported if the count exceeds the
// limits.
Result<SogLayout> sog_layout(const nlohmann::json& root, CodebookRule rule,
                             const std::string& label, const ReadLimits& limits);

}  // namespace stgs
