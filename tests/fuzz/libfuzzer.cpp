// SPDX-License-Identifier: Apache-2.0
// Connects a target to libFuzzer or another engine with its interface: the heap limit of each
// input, and the structure-aware mutator besides that of the engine.
#include <algorithm>

#include "heap.h"
#include "mutator.h"
#include "two_cores.h"

using namespace stgs::fuzz;

// Null with an engine that has none.
extern "C" [[gnu::weak]] std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size,
                                                      std::size_t max_bytes);
extern "C" int __real_LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

// The linker makes the engine call this function (--wrap).
extern "C" int __wrap_LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const bool restricted = (use_two_cores(), true);  // as in the plain driver
  (void)restricted;
  limit_heap(kTarget.max_memory({data, size}));
  const int result = __real_LLVMFuzzerTestOneInput(data, size);
  unlimit_heap();
  return result;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t max_bytes, unsigned seed) {
  Random random(seed);
  Bytes out;
  if (random.one_in(3) && kTarget.repack != nullptr && LLVMFuzzerMutate != nullptr) {
    // A mutation of libFuzzer, applied to the unpacked form.
    out = kTarget.unpack != nullptr ? kTarget.unpack({data, size}) : Bytes(data, data + size);
    const std::size_t old_size = out.size();
    out.resize(old_size + 64);
    out.resize(LLVMFuzzerMutate(out.data(), old_size, out.size()));
    out = kTarget.repack(std::move(out), random.one_in(2) ? Repair::kSizes : Repair::kChecksums);
  } else {
    out = mutate(kTarget, {data, size}, {data, size}, max_bytes, random);
  }
  const std::size_t count = std::min(out.size(), max_bytes);
  std::copy_n(out.begin(), count, data);
  return count;
}

// Splices bytes of one input into another.
extern "C" std::size_t LLVMFuzzerCustomCrossOver(const std::uint8_t* a, std::size_t a_size,
                                                 const std::uint8_t* b, std::size_t b_size,
                                                 std::uint8_t* out, std::size_t max_bytes,
                                                 unsigned seed) {
  Random random(seed);
  const Bytes bytes = mutate(kTarget, {a, a_size}, {b, b_size}, max_bytes, random);
  std::copy(bytes.begin(), bytes.end(), out);
  return bytes.size();
}
