// SPDX-License-Identifier: Apache-2.0
// What a device's memory can do.
#pragma once

#include "vulkan/device.h"

namespace stgs::player::vulkan {

// Bytes a second that a shader which copies reads and writes, more than caches hold: Vulkan does
// not tell, and its own copies can be several times slower. Waits for the device, which has
// timestamps.
Result<double> copied_bytes_per_second(Device& device);

}  // namespace stgs::player::vulkan
