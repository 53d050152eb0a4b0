// SPDX-License-Identifier: Apache-2.0
// Copies structs to and from callers of other versions. A struct begins with its size, as declared
// in the caller's header, and grows only at its end, by members at multiples of 8 bytes. A program
// compiled with an older header passes a shorter struct, one with a newer header a longer one.
#pragma once

#include <algorithm>
#include <cstring>
#include <span>
#include <type_traits>

#include "object.h"

namespace stgs::sdk {

inline constexpr std::size_t kMaxStructBytes = 4096;

// Returns whether some version of the struct may have this size.
template <typename T>
constexpr bool is_struct_size(std::size_t bytes) {
  static_assert(std::is_trivially_copyable_v<T> && alignof(T) == alignof(std::size_t));
  return bytes > sizeof(std::size_t) && bytes % alignof(T) == 0 && bytes <= kMaxStructBytes;
}

// Checks the size of a struct that the library writes.
template <typename T>
stgs_result check_struct(const T* given) {
  if (given == nullptr) return STGS_ERROR_ARGUMENT;
  return is_struct_size<T>(given->struct_size) ? STGS_OK : STGS_ERROR_STRUCT_SIZE;
}
template <typename T>
Outcome check_struct(const T* given, const char* name) {
  const stgs_result result = check_struct(given);
  if (result == STGS_OK) return {};
  if (result == STGS_ERROR_ARGUMENT) return {result, fmt::format("{} is NULL", name)};
  return {result, fmt::format("{}: struct_size is {} (expected its sizeof, {})", name,
                              given->struct_size, sizeof(T))};
}

// Writes `value` to the caller's struct, whose size has been checked: as many bytes as it has, and
// 0 to the rest.
template <typename T>
void copy_out(T* to, const T& value) {
  const std::size_t size = to->struct_size;
  auto* bytes = reinterpret_cast<unsigned char*>(to);
  const std::size_t known = std::min(size, sizeof(T));
  std::memcpy(bytes, &value, known);
  std::memset(bytes + known, 0, size - known);
  std::memcpy(bytes, &size, sizeof(size));
}

// Reads the caller's struct into `known`, which holds the defaults of members that it lacks.
// Members of later versions must be 0, because the library would ignore them.
template <typename T>
stgs_result copy_in(const T* given, T& known) {
  if (const stgs_result bad = check_struct(given); bad != STGS_OK) return bad;
  const std::size_t size = given->struct_size;
  const auto* bytes = reinterpret_cast<const unsigned char*>(given);
  if (size > sizeof(T) &&
      std::any_of(bytes + sizeof(T), bytes + size, [](unsigned char byte) { return byte != 0; })) {
    return STGS_ERROR_STRUCT_SIZE;
  }
  std::memcpy(&known, bytes, std::min(size, sizeof(T)));
  known.struct_size = sizeof(T);
  return STGS_OK;
}
template <typename T>
Outcome copy_in(const T* given, T& known, const char* name) {
  STGS_SDK_TRY(check_struct(given, name));
  const stgs_result result = copy_in(given, known);
  if (result == STGS_OK) return {};
  return {result, fmt::format("{}: sets members that this library does not know (struct_size is "
                              "{}, expected at most {}); the library is older than the header",
                              name, given->struct_size, sizeof(T))};
}
// Reads a contiguous array of structs, all of one size. `known` holds the same number of defaults.
template <typename T>
Outcome copy_in_array(const T* first, std::span<T> known, const char* name) {
  const auto* bytes = reinterpret_cast<const unsigned char*>(first);
  for (T& one : known) {
    const T* given = reinterpret_cast<const T*>(bytes);
    STGS_SDK_TRY(copy_in(given, one, name));
    if (given->struct_size != first->struct_size) {
      return {STGS_ERROR_STRUCT_SIZE,
              fmt::format("{}: all elements must have one struct_size (got {} and {})", name,
                          first->struct_size, given->struct_size)};
    }
    bytes += first->struct_size;
  }
  return {};
}

// Fills the caller's struct, whose content is arbitrary, with defaults.
template <typename T>
stgs_result fill_defaults(T* out, std::size_t struct_size, const T& defaults) {
  if (out == nullptr) return STGS_ERROR_ARGUMENT;
  if (!is_struct_size<T>(struct_size)) return STGS_ERROR_STRUCT_SIZE;
  out->struct_size = struct_size;
  copy_out(out, defaults);
  return STGS_OK;
}

}  // namespace stgs::sdk
