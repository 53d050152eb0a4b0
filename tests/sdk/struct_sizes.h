// SPDX-License-Identifier: Apache-2.0
// Structs of the C API as passed by programs built with older or newer headers.
#pragma once

#include <algorithm>
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

// A struct in an allocation of another size, at the end of which a memory checker detects overruns.
template <typename T>
class Sized {
 public:
  // Copies the first `size` bytes of `value`; bytes beyond the struct are set to `fill`.
  Sized(std::size_t size, const T& value, unsigned char fill = 0)
      : size_(size), bytes_(static_cast<unsigned char*>(::operator new(size))) {
    std::memset(bytes_.get(), fill, size);
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

// Checks a struct that the library reads. `use` succeeds with `value`, and still succeeds when all
// but the first `min_size` bytes are left to the defaults.
template <typename T, typename Use>
void check_input_struct(const char* name, const T& value, std::size_t min_size, Use&& use) {
  for (std::size_t size = 16; size <= sizeof(T) + 64; size += 8) {
    INFO(name << " of " << size << " bytes, not " << sizeof(T));
    const stgs_result result = use(Sized<T>(size, value).get());
    if (size >= min_size) {
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

// Checks a struct that the library writes.
template <typename T, typename Use>
void check_output_struct(const char* name, Use&& use) {
  T full{};
  full.struct_size = sizeof full;
  REQUIRE(use(&full) == STGS_OK);
  for (std::size_t size = 16; size <= sizeof(T) + 64; size += 8) {
    INFO(name << " of " << size << " bytes, not " << sizeof(T));
    Sized<T> output(size, T{}, 0xA5);
    REQUIRE(use(output.get()) == STGS_OK);
    const std::size_t known = std::min(size, sizeof(T)), skip = sizeof(std::size_t);
    CHECK(output.get()->struct_size == size);
    CHECK(std::memcmp(output.bytes() + skip, reinterpret_cast<const char*>(&full) + skip,
                      known - skip) == 0);
    CHECK(std::all_of(output.bytes() + known, output.bytes() + size,
                      [](unsigned char byte) { return byte == 0; }));
  }
  for (const std::size_t size : {std::size_t{0}, std::size_t{8}, sizeof(T) - 4, sizeof(T) + 1}) {
    INFO(name << " of " << size << " bytes");
    full.struct_size = size;
    CHECK(use(&full) == STGS_ERROR_STRUCT_SIZE);
  }
}

// Returns the defaults of a struct, after checking the function that fills them.
template <typename Settings>
Settings defaults_of(stgs_result (*defaults)(Settings*, std::size_t)) {
  check_output_struct<Settings>("defaults", [&](Settings* out) {
    const std::size_t size = out->struct_size;
    return defaults(out, size);
  });
  Settings settings;
  REQUIRE(defaults(&settings, sizeof settings) == STGS_OK);
  return settings;
}

// Returns the names of the structs in a header that begin with struct_size.
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
