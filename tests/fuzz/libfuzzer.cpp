// SPDX-License-Identifier: Apache-2.0
// Gives libFuzzer the mutator that knows the formats, beside its own.
#include <algorithm>

#include "mutator.h"

using namespace stgs::fuzz;

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t most);

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t most, unsigned seed) {
  Random random(seed);
  Bytes out;
  if (random.chance(3) && kTarget.close != nullptr) {
    // Its own change, made where it has an effect.
    out = kTarget.open != nullptr ? kTarget.open({data, size}) : Bytes(data, data + size);
    const std::size_t old = out.size();
    out.resize(old + 64);
    out.resize(LLVMFuzzerMutate(out.data(), old, out.size()));
    out = kTarget.close(std::move(out), random.chance(2) ? Repair::kSizes : Repair::kChecksums);
  } else {
    out = mutate(kTarget, {data, size}, {data, size}, most, random);
  }
  const std::size_t count = std::min(out.size(), most);
  std::copy_n(out.begin(), count, data);
  return count;
}

// Bytes of one input in another's place.
extern "C" std::size_t LLVMFuzzerCustomCrossOver(const std::uint8_t* a, std::size_t a_size,
                                                 const std::uint8_t* b, std::size_t b_size,
                                                 std::uint8_t* out, std::size_t most,
                                                 unsigned seed) {
  Random random(seed);
  const Bytes bytes = mutate(kTarget, {a, a_size}, {b, b_size}, most, random);
  std::copy(bytes.begin(), bytes.end(), out);
  return bytes.size();
}
