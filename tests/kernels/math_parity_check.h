// SPDX-License-Identifier: Apache-2.0
// The random primitives of the parity tests, and the tolerances of spec/representation.md, 7.
#ifndef STGS_TESTS_MATH_PARITY_CHECK_H
#define STGS_TESTS_MATH_PARITY_CHECK_H

#include <cstdint>
#include <string>
#include <vector>

#include "math_parity.h"

namespace stgs::test {

// `count` primitives seen by as many cameras, about one in twenty of them behind its camera.
std::vector<math::ParityGiven> parity_primitives(std::size_t count, std::uint32_t seed);

// How far one quantity is off over all primitives.
struct ParityRow {
  std::string quantity;
  std::size_t compared = 0;
  double worst = 0.0;             // largest difference as a share of the tolerance; 1 passes
  double worst_difference = 0.0;  // largest difference, in the quantity's own unit
  std::size_t worst_index = 0;    // the primitive with the largest share
};

// Compares with the C++ evaluation of the same primitives, a row a quantity.
std::vector<ParityRow> compare_parity(const std::vector<math::ParityGiven>& given,
                                      const std::vector<math::ParityFound>& found);

// The rows as a table, for the test's output.
std::string parity_table(const std::vector<ParityRow>& rows);

}  // namespace stgs::test

#endif
