/* SPDX-License-Identifier: Apache-2.0 */
/* The header is self-contained and can be included twice. */
#include "stgs/stgs_vulkan.h"

#include "stgs/stgs_vulkan.h"

stgs_result call_vulkan_from_c(stgs_vulkan_device* device);
stgs_result call_vulkan_from_c(stgs_vulkan_device* device) {
  return stgs_vulkan_device_defaults(device, sizeof *device);
}
