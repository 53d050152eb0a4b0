// SPDX-License-Identifier: Apache-2.0
// The code of volk, which opens the Vulkan loader at run time: programs start without one.
#define VOLK_IMPLEMENTATION
#include <volk.h>
