// SPDX-License-Identifier: Apache-2.0
// Runs a check on every vector target that the build contains and the CPU supports.
#pragma once

#include <hwy/targets.h>

namespace stgs::testing {

template <typename Check>
void for_each_vector_target(Check check) {
#if defined(__EMSCRIPTEN__)  // has one target
  check();
#else
  for (std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().DeInit();
    check();
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().DeInit();
#endif
}

}  // namespace stgs::testing
