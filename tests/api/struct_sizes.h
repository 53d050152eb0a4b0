// SPDX-License-Identifier: Apache-2.0
// Structs of the C interface as programs with older and with newer headers hand them over.
#pragma once

#include <cstdint>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "catch.h"
#include "stgs/stgs.h"

namespace stgs::testing {

// A struct with bytes behind it, in memory that ends with them.
template <typename T>
class Sized {
 public:
  // Of the first `size` bytes of `value`; what it has beyond, `rest`.
  Sized(std::size_t size, const T& value, unsigned char rest = 0)
      : size_(size), bytes_(static_cast<unsigned char*>(::operator new(size))) {
    std::memset(bytes_.get(), rest, size);
    std::memcpy(bytes_.get(), &value, std::min(size, sizeof value));
    std::memcpy(bytes_.get(), &size, std::min(size, sizeof size));
  }
  T* get() { return reinterpret_cast<T*>(bytes_.get()); }
  const unsigned char* bytes() const { return bytes_.get(); }
  unsigned char& last() { return bytes_[size_ - 1]; }

 private:
  struct Free {
    void operator()(unsigned char* bytes) const { ::operator delete(bytes); }
  };
  std::size_t size_;
  std::unique_ptr<unsigned char[], Free> bytes_;
};

// A struct that the library reads: `value` is one with which `use` succeeds, also where all beyond
// its first `least` bytes is left to the defaults.
template <typename T, typename Use>
void check_taken(const char* name, const T& value, std::size_t least, Use&& use) {
  for (std::size_t size = 16; size <= sizeof(T) + 64; size += 8) {
    INFO(name << " of " << size << " bytes, not " << sizeof(T));
    const stgs_result result = use(Sized<T>(size, value).get());
    if (size >= least) {
      CHECK(result == STGS_OK);
    } else {
      CHECK(result != STGS_ERROR_STRUCT_SIZE);
    }
    if (size <= sizeof(T)) continue;
    Sized<T> unknown(size, value);
    unknown.last() = 1;
    CHECK(use(unknown.get()) == STGS_ERROR_STRUCT_SIZE);
  }
  for (const std::size_t size : {std::size_t{0}, std::size_t{8}, sizeof(T) - 4, sizeof(T) + 1}) {
    INFO(name << " of " << size << " bytes");
    T wrong = value;
    wrong.struct_size = size;
    CHECK(use(&wrong) == STGS_ERROR_STRUCT_SIZE);
  }
}

// A struct that the library writes.
template <typename T, typename Use>
void check_given(const char* name, Use&& use) {
  T whole{};
  whole.struct_size = sizeof whole;
  REQUIRE(use(&whole) == STGS_OK);
  for (std::size_t size = 16; size <= sizeof(T) + 64; size += 8) {
    INFO(name << " of " << size << " bytes, not " << sizeof(T));
    Sized<T> given(size, T{}, 0xA5);
    REQUIRE(use(given.get()) == STGS_OK);
    const std::size_t known = std::min(size, sizeof(T)), skip = sizeof(std::size_t);
    CHECK(given.get()->struct_size == size);
    CHECK(std::memcmp(given.bytes() + skip, reinterpret_cast<const char*>(&whole) + skip,
                      known - skip) == 0);
    CHECK(std::all_of(given.bytes() + known, given.bytes() + size,
                      [](unsigned char byte) { return byte == 0; }));
  }
  for (const std::size_t size : {std::size_t{0}, std::size_t{8}, sizeof(T) - 4, sizeof(T) + 1}) {
    INFO(name << " of " << size << " bytes");
    whole.struct_size = size;
    CHECK(use(&whole) == STGS_ERROR_STRUCT_SIZE);
  }
}

// The structs of a header that begin with their size.
inline std::set<std::string> sized_structs(const std::string& header) {
  std::ifstream file(header);
  REQUIRE(file);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  const std::regex begin(R"(typedef struct (\w+) \{\s*size_t struct_size;)");
  std::set<std::string> out;
  for (std::sregex_iterator i(text.begin(), text.end(), begin), end; i != end; ++i) {
    out.insert((*i)[1]);
  }
  return out;
}

}  // namespace stgs::testing
