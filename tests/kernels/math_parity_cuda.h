// SPDX-License-Identifier: Apache-2.0
// Evaluates format/math on a CUDA device.
#ifndef STGS_TESTS_MATH_PARITY_CUDA_H
#define STGS_TESTS_MATH_PARITY_CUDA_H

#include <string>
#include <vector>

#include "math_parity.h"

namespace stgs::test {

// Returns why no CUDA device can be used; empty if one can.
std::string cuda_unavailable_reason();

// Evaluates every primitive on the current device. Returns an error message or "".
std::string evaluate_on_cuda(const std::vector<math::ParityInput>& inputs,
                             std::vector<math::ParityResult>* results);

}  // namespace stgs::test

#endif
