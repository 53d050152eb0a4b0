// SPDX-License-Identifier: Apache-2.0
// Structs that callers hand over. A struct begins with its size, as the caller's header has it, and
// grows at its end alone, by members that begin at a multiple of 8 bytes: a program that was
// compiled with an older header gives less, one with a newer header more.
#pragma once

#include <algorithm>
#include <cstring>
#include <span>
#include <type_traits>

#include "object.h"

namespace stgs::sdk {

inline constexpr std::size_t kMostStructBytes = 4096;

// Whether some version's struct may be of that size.
template <typename T>
constexpr bool is_struct_size(std::size_t bytes) {
  static_assert(std::is_trivially_copyable_v<T> && alignof(T) == alignof(std::size_t));
  return bytes > sizeof(std::size_t) && bytes % alignof(T) == 0 && bytes <= kMostStructBytes;
}

// Whether a struct that is written to has such a size.
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
  return {result, fmt::format("{}: struct_size is {}, not {}; set it to its sizeof", name,
                              given->struct_size, sizeof(T))};
}

// Writes what the caller's struct, which has been checked, has room for; what it has beyond is 0.
template <typename T>
void give_struct(T* to, const T& value) {
  const std::size_t size = to->struct_size;
  auto* bytes = reinterpret_cast<unsigned char*>(to);
  const std::size_t known = std::min(size, sizeof(T));
  std::memcpy(bytes, &value, known);
  std::memset(bytes + known, 0, size - known);
  std::memcpy(bytes, &size, sizeof(size));
}

// Reads what the caller's struct has over `known`, which holds the defaults of what it lacks. What
// only a later version knows must be 0: it would be passed over.
template <typename T>
stgs_result take_struct(const T* given, T& known) {
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
Outcome take_struct(const T* given, T& known, const char* name) {
  STGS_SDK_TRY(check_struct(given, name));
  const stgs_result result = take_struct(given, known);
  if (result == STGS_OK) return {};
  return {result, fmt::format("{}: its {} bytes set what this library, which knows {}, does not "
                              "have; it is older than the header",
                              name, given->struct_size, sizeof(T))};
}
// An array of them, side by side, all of one size; `known` are as many with defaults.
template <typename T>
Outcome take_structs(const T* first, std::span<T> known, const char* name) {
  const auto* bytes = reinterpret_cast<const unsigned char*>(first);
  for (T& one : known) {
    const T* given = reinterpret_cast<const T*>(bytes);
    STGS_SDK_TRY(take_struct(given, one, name));
    if (given->struct_size != first->struct_size) {
      return {STGS_ERROR_STRUCT_SIZE, fmt::format("{}: struct_size is {} and {} in one array", name,
                                                  first->struct_size, given->struct_size)};
    }
    bytes += first->struct_size;
  }
  return {};
}

// Fills a struct of the caller's, which may have any content, with defaults.
template <typename T>
stgs_result put_defaults(T* out, std::size_t struct_size, const T& defaults) {
  if (out == nullptr) return STGS_ERROR_ARGUMENT;
  if (!is_struct_size<T>(struct_size)) return STGS_ERROR_STRUCT_SIZE;
  out->struct_size = struct_size;
  give_struct(out, defaults);
  return STGS_OK;
}

}  // namespace stgs::sdk
