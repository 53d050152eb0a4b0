// SPDX-License-Identifier: Apache-2.0
// Vulkan for the player window: volk, which must precede other Vulkan headers, and the library.
#pragma once

#include <volk.h>

#include "stgs/stgs_vulkan.h"
