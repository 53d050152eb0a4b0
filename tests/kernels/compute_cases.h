// SPDX-License-Identifier: Apache-2.0
// The main() of the tests of compute shaders, and the Vulkan host that their cases share.
#pragma once

#include "vulkan_compute.h"

namespace stgs::testing {

// The host of run_compute_cases(), one for all cases, because making a host is slow under the
// validation layer.
test::VulkanCompute& compute();

// Makes compute() and runs the test cases that the arguments select. Prints the messages of the
// validation layer, each of which is a failure, or that the layer is not installed. Destroys the
// host before the program ends: the layer cannot be used once its own static objects are destroyed.
// Returns the exit code, 77 (skipped) if there is no device.
int run_compute_cases(int argc, char** argv);

}  // namespace stgs::testing
