/* SPDX-License-Identifier: Apache-2.0 */
/* The header needs nothing before it, and may be there twice. */
#include "stgs/stgs_vulkan.h"

#include "stgs/stgs_vulkan.h"

stgs_result vulkan_of_library_again(stgs_vulkan_device* device);
stgs_result vulkan_of_library_again(stgs_vulkan_device* device) {
  return stgs_vulkan_device_defaults(device, sizeof *device);
}
