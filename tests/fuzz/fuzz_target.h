// SPDX-License-Identifier: Apache-2.0
// What a fuzz target is: one interface that reads bytes from outside, and how to change those bytes
// so that the changes get past checksums and compression. README.md says how to run them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <vector>

namespace stgs::fuzz {

using Bytes = std::vector<std::uint8_t>;
using View = std::span<const std::uint8_t>;

// Bytes [begin, end) of an input that make sense together: a record, an array, a table.
struct Unit {
  std::size_t begin = 0, end = 0;
};

// How much the mutator repairs after a change.
enum class Repair {
  kNothing,
  kChecksums,  // so that what was changed is looked at
  kSizes,      // and sizes and places too, so that a unit may grow, go or come twice
};

// One per program.
struct Target {
  const char* name;  // of its folder in corpus/
  // Sound inputs, small, made by this version's writers where there are any.
  std::vector<Bytes> (*seeds)();
  // To a form in which a changed byte changes one thing (unpacked), and back to what is read. Both
  // take any bytes. Null: the bytes as they are.
  Bytes (*open)(View input) = nullptr;
  Bytes (*close)(Bytes form, Repair repair) = nullptr;
  // Units of an opened input; null: it has none.
  std::vector<Unit> (*units)(View form) = nullptr;
  // The most heap that reading an input of this size may take, bytes.
  std::uint64_t (*most_memory)(View input) = nullptr;
};
extern const Target kTarget;

// Ends the process where a property of the code under test does not hold.
inline void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "fuzz: broken property: %s\n", what);
  std::abort();
}

}  // namespace stgs::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
