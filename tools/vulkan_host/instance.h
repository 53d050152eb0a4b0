// SPDX-License-Identifier: Apache-2.0
// Creates Vulkan instances, with the validation layer if it is installed.
#pragma once

#include <volk.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace stgs::tools {

// Settings of make_instance().
struct InstanceSettings {
  const char* application = nullptr;  // application name; may be null
  std::uint32_t api_version = VK_API_VERSION_1_1;
  std::vector<const char*> extensions;
  // If set, enables the validation layer with synchronisation validation, provided that the layer
  // is installed, and receives its warnings and errors on any thread. Outlives the instance.
  const std::function<void(const std::string&)>* on_message = nullptr;
};

struct Instance {
  VkInstance handle = VK_NULL_HANDLE;
  VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;  // null: validation is off
};

// Creates an instance. Call it after volkInitialize(); it does not load volk's instance functions.
// On failure, the handles in `out` are null.
VkResult make_instance(const InstanceSettings& settings, Instance& out);
// Destroys an instance whose devices have been destroyed. No effect if its handle is null.
void destroy_instance(const Instance& instance);

}  // namespace stgs::tools
