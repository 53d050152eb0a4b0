// SPDX-License-Identifier: Apache-2.0
// format/math on a CUDA device.
#ifndef STGS_TESTS_MATH_PARITY_CUDA_H
#define STGS_TESTS_MATH_PARITY_CUDA_H

#include <string>
#include <vector>

#include "math_parity.h"

namespace stgs::test {

// Why there is nothing to run on; empty where there is a device.
std::string cuda_missing();

// Evaluates every primitive on the current device. Returns an error message or "".
std::string parity_on_cuda(const std::vector<math::ParityGiven>& given,
                           std::vector<math::ParityFound>* found);

}  // namespace stgs::test

#endif
