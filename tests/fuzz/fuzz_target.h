// SPDX-License-Identifier: Apache-2.0
// A fuzz target: one interface that reads untrusted bytes, and the knowledge of their structure
// that lets mutations get past checksums and compression. README.md describes how to run targets.
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

// Bytes [begin, end) of an input that form a unit: a record, an array, a table.
struct Unit {
  std::size_t begin = 0, end = 0;
};

// What the mutator repairs after a change.
enum class Repair {
  kNothing,
  kChecksums,  // so that readers reach the changed bytes
  kSizes,      // checksums, sizes and offsets, so that units may grow, vanish or repeat
};

// Each program defines one.
struct Target {
  const char* name;  // also the name of its folder in corpus/
  // Small valid inputs, written by this version where it has a writer.
  std::vector<Bytes> (*seeds)();
  // `unpack` returns a form in which changing a byte changes one thing; `repack` returns the bytes
  // that are read. Both accept any bytes. Null: the input is mutated as it is.
  Bytes (*unpack)(View input) = nullptr;
  Bytes (*repack)(Bytes form, Repair repair) = nullptr;
  // Returns the units of an unpacked input. Null: the input has none.
  std::vector<Unit> (*units)(View form) = nullptr;
  // Returns the heap limit for reading an input, in bytes.
  std::uint64_t (*max_memory)(View input) = nullptr;
  // Returns whether the device exists whose driver the target uses. Null: it uses none.
  bool (*has_device)() = nullptr;
};
extern const Target kTarget;

// Aborts if a property of the code under test does not hold. `property` states the property.
inline void require(bool holds, const char* property) {
  if (holds) return;
  std::fprintf(stderr, "fuzz: violated property: %s\n", property);
  std::abort();
}

}  // namespace stgs::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
