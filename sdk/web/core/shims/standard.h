// SPDX-License-Identifier: Apache-2.0
// Functions of C++20's standard library that libc++ 13 lacks. Included before every source of the
// WASM core.
#pragma once

#ifdef __cplusplus
#include <version>

#include <bit>
#include <cstring>
#include <memory>
#include <type_traits>

namespace std {

#ifndef __cpp_lib_bit_cast
template <typename To, typename From>
constexpr To bit_cast(const From& from) noexcept {
  static_assert(sizeof(To) == sizeof(From) && is_trivially_copyable_v<To> &&
                is_trivially_copyable_v<From>);
  return __builtin_bit_cast(To, from);
}
#endif

#ifndef __cpp_lib_smart_ptr_for_overwrite
template <typename Array>
unique_ptr<Array> make_unique_for_overwrite(size_t count) {
  static_assert(is_array_v<Array> && extent_v<Array> == 0);
  return unique_ptr<Array>(new remove_extent_t<Array>[count]);
}
#endif

}  // namespace std
#endif
