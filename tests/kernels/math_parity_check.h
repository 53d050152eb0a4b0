// SPDX-License-Identifier: Apache-2.0
// Random primitives for the parity tests, and the tolerances of spec/representation.md, 7.
#ifndef STGS_TESTS_MATH_PARITY_CHECK_H
#define STGS_TESTS_MATH_PARITY_CHECK_H

#include <cstdint>
#include <string>
#include <vector>

#include "math_parity.h"

namespace stgs::test {

// Returns `count` primitives, each with its own camera; about one in twenty is behind its camera.
std::vector<math::ParityInput> random_parity_inputs(std::size_t count, std::uint32_t seed);

// The differences of one quantity over all primitives.
struct ParityRow {
  std::string quantity;
  std::size_t compared = 0;
  double worst = 0.0;             // largest difference relative to the tolerance; up to 1 passes
  double worst_difference = 0.0;  // largest difference in the unit of the quantity
  std::size_t worst_index = 0;    // the primitive with the largest relative difference
};

// Compares with the C++ evaluation of the same primitives; one row per quantity.
std::vector<ParityRow> compare_parity(const std::vector<math::ParityInput>& inputs,
                                      const std::vector<math::ParityResult>& results);

// Formats the rows as a table for the output of the test.
std::string parity_table(const std::vector<ParityRow>& rows);

}  // namespace stgs::test

#endif
