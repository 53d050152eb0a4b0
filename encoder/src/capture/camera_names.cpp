// SPDX-License-Identifier: Apache-2.0
#include "camera_names.h"

#include <algorithm>
#include <cctype>

namespace stgs::encoder {

// As of the folders and files that cameras are named after.
constexpr std::size_t kMaxNameBytes = 255;

// Runs of letters, split where lower case turns to upper case, and numbers without leading zeros.
CameraNames::Words CameraNames::words_of(const std::string& name) {
  enum class Kind { kOther, kDigit, kLower, kUpper };
  Words words;
  Kind last = Kind::kOther;
  for (const char c : name) {
    const auto byte = static_cast<unsigned char>(c);
    const Kind kind = std::isdigit(byte) != 0                   ? Kind::kDigit
                      : std::isupper(byte) != 0                 ? Kind::kUpper
                      : std::isalpha(byte) != 0 || byte >= 0x80 ? Kind::kLower
                                                                : Kind::kOther;
    const bool continues = kind == last || (last == Kind::kUpper && kind == Kind::kLower);
    if (kind != Kind::kOther && !continues) words.emplace_back();
    if (kind != Kind::kOther) {
      if (words.back() == "0" && kind == Kind::kDigit) words.back().clear();
      words.back() += static_cast<char>(std::tolower(byte));
    }
    last = kind;
  }
  return words;
}

bool CameraNames::match(const Words& a, const Words& b) {
  const Words &longer = a.size() < b.size() ? b : a, &shorter = a.size() < b.size() ? a : b;
  return !shorter.empty() &&
         std::search(longer.begin(), longer.end(), shorter.begin(), shorter.end()) != longer.end();
}

CameraNames::CameraNames(const std::vector<SourceCamera>& cameras) {
  for (const SourceCamera& camera : cameras) {
    names_.push_back(camera.name);
    words_.push_back(words_of(camera.name));
  }
}

bool CameraNames::any(const std::string& name) const {
  if (name.size() > kMaxNameBytes) return false;
  const Words words = words_of(name);
  return std::any_of(words_.begin(), words_.end(),
                     [&](const Words& own) { return match(words, own); });
}

Result<std::size_t> CameraNames::find(const std::string& name, const std::string& path) const {
  if (name.size() > kMaxNameBytes) {
    return invalid_file("{}: the name of a camera has {} bytes (expected at most {})", path,
                        name.size(), kMaxNameBytes);
  }
  if (const auto equal = std::find(names_.begin(), names_.end(), name); equal != names_.end())
    return static_cast<std::size_t>(equal - names_.begin());
  const Words words = words_of(name);
  std::size_t found = names_.size();
  for (std::size_t i = 0; i < names_.size(); ++i) {
    if (!match(words, words_[i])) continue;
    if (found < names_.size()) {
      return invalid_file(
          "{}: camera '{}' could be '{}' or '{}'; rename the videos or image folders after the "
          "cameras of the calibration",
          path, name, names_[found], names_[i]);
    }
    found = i;
  }
  return found;
}

}  // namespace stgs::encoder
