// SPDX-License-Identifier: Apache-2.0
#include "camera_names.h"

#include <algorithm>
#include <cctype>

namespace stgs::encoder {

namespace {

constexpr std::size_t kMaxNameBytes = 255;  // NAME_MAX: cameras are named after files and folders
constexpr char kEnd = '\0';

// Returns runs of letters, split where lower case turns to upper case, and numbers without leading
// zeros, with kEnd before and after each.
std::string words_of(const std::string& name) {
  enum class Kind { kOther, kDigit, kLower, kUpper };
  std::string words;
  std::size_t first = 0;  // of the last word
  Kind last = Kind::kOther;
  for (const char c : name) {
    const auto byte = static_cast<unsigned char>(c);
    const Kind kind = std::isdigit(byte) != 0                   ? Kind::kDigit
                      : std::isupper(byte) != 0                 ? Kind::kUpper
                      : std::isalpha(byte) != 0 || byte >= 0x80 ? Kind::kLower
                                                                : Kind::kOther;
    const bool continues = kind == last || (last == Kind::kUpper && kind == Kind::kLower);
    if (kind != Kind::kOther && !continues) {
      words += kEnd;
      first = words.size();
    }
    if (kind != Kind::kOther) {
      if (kind == Kind::kDigit && words.size() == first + 1 && words.back() == '0')
        words.pop_back();
      words += static_cast<char>(std::tolower(byte));
    }
    last = kind;
  }
  return words.empty() ? words : words + kEnd;
}

bool match(const std::string& a, const std::string& b) {
  const std::string &longer = a.size() < b.size() ? b : a, &shorter = a.size() < b.size() ? a : b;
  return !shorter.empty() && longer.find(shorter) != std::string::npos;
}

}  // namespace

CameraNames::CameraNames(const std::vector<SourceCamera>& cameras) {
  for (const SourceCamera& camera : cameras) {
    names_.push_back(camera.name);
    words_.push_back(words_of(camera.name));
  }
}

bool CameraNames::any(const std::string& name) const {
  if (name.size() > kMaxNameBytes) return false;
  const std::string words = words_of(name);
  return std::any_of(words_.begin(), words_.end(),
                     [&](const std::string& own) { return match(words, own); });
}

Result<std::size_t> CameraNames::find(const std::string& name, const std::string& path) const {
  if (name.size() > kMaxNameBytes) {
    return invalid_file("{}: the name of a camera has {} bytes (expected at most {})", path,
                        name.size(), kMaxNameBytes);
  }
  if (const auto equal = std::find(names_.begin(), names_.end(), name); equal != names_.end())
    return static_cast<std::size_t>(equal - names_.begin());
  const std::string words = words_of(name);
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
