// SPDX-License-Identifier: Apache-2.0
// Measures the bandwidth of a device's memory.
#pragma once

#include "vulkan/device.h"

namespace stgs::player::vulkan {

// Returns the bytes per second that a copy shader reads and writes, with buffers larger than
// caches. Vulkan does not report the bandwidth, and its copy commands can be several times slower.
// Waits for the device, which must support timestamps.
Result<double> measure_bandwidth(Device& device);

}  // namespace stgs::player::vulkan
