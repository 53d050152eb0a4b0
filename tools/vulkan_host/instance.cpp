// SPDX-License-Identifier: Apache-2.0
#include "vulkan_host/instance.h"

#include <algorithm>
#include <cstring>

#include "vulkan_host/objects.h"

namespace stgs::tools {
namespace {

// Volk's functions may be those of another instance, so every function is queried.
template <typename Function>
Function function_of(VkInstance instance, const char* name) {
  return reinterpret_cast<Function>(vkGetInstanceProcAddr(instance, name));
}

constexpr const char* kLayer = "VK_LAYER_KHRONOS_validation";

VKAPI_ATTR VkBool32 VKAPI_CALL on_message(VkDebugUtilsMessageSeverityFlagBitsEXT,
                                          VkDebugUtilsMessageTypeFlagsEXT,
                                          const VkDebugUtilsMessengerCallbackDataEXT* data,
                                          void* callback) {
  (*static_cast<const std::function<void(const std::string&)>*>(callback))(data->pMessage);
  return VK_FALSE;
}

bool has_validation_layer() {
  std::uint32_t count = 0;
  if (vkEnumerateInstanceLayerProperties(&count, nullptr) != VK_SUCCESS) return false;
  std::vector<VkLayerProperties> layers(count);
  if (vkEnumerateInstanceLayerProperties(&count, layers.data()) != VK_SUCCESS) return false;
  return std::any_of(layers.begin(), layers.end(), [](const VkLayerProperties& layer) {
    return std::strcmp(layer.layerName, kLayer) == 0;
  });
}

VkDebugUtilsMessengerCreateInfoEXT messenger_to(
    const std::function<void(const std::string&)>* callback) {
  auto info = structure<VkDebugUtilsMessengerCreateInfoEXT>(
      VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT);
  info.messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT |
                         VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
  info.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT |
                     VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT;
  info.pfnUserCallback = on_message;
  info.pUserData = const_cast<std::function<void(const std::string&)>*>(callback);
  return info;
}

}  // namespace

VkResult make_instance(const InstanceSettings& settings, Instance& out) {
  out = {};
  auto application = structure<VkApplicationInfo>(VK_STRUCTURE_TYPE_APPLICATION_INFO);
  application.pApplicationName = settings.application;
  application.apiVersion = settings.api_version;
  auto info = structure<VkInstanceCreateInfo>(VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO);
  info.pApplicationInfo = &application;
  // Also in the pNext chain, to validate the creation and destruction of the instance itself.
  const auto debug = messenger_to(settings.on_message);
  const VkValidationFeatureEnableEXT synchronisation =
      VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT;
  auto features = structure<VkValidationFeaturesEXT>(VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT);
  features.pNext = &debug;
  features.enabledValidationFeatureCount = 1;
  features.pEnabledValidationFeatures = &synchronisation;
  std::vector<const char*> extensions = settings.extensions;
  const bool validated = settings.on_message != nullptr && has_validation_layer();
  if (validated) {
    extensions.push_back(VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
    info.pNext = &features;
    info.enabledLayerCount = 1;
    info.ppEnabledLayerNames = &kLayer;
  }
  info.enabledExtensionCount = static_cast<std::uint32_t>(extensions.size());
  info.ppEnabledExtensionNames = extensions.data();
  VkResult result = vkCreateInstance(&info, nullptr, &out.handle);
  if (result != VK_SUCCESS) out.handle = VK_NULL_HANDLE;
  if (result != VK_SUCCESS || !validated) return result;
  const auto make_messenger =
      function_of<PFN_vkCreateDebugUtilsMessengerEXT>(out.handle, "vkCreateDebugUtilsMessengerEXT");
  result = make_messenger(out.handle, &debug, nullptr, &out.messenger);
  if (result == VK_SUCCESS) return result;
  destroy_instance({out.handle});
  out = {};
  return result;
}

void destroy_instance(const Instance& instance) {
  if (instance.handle == VK_NULL_HANDLE) return;
  if (instance.messenger != VK_NULL_HANDLE) {
    function_of<PFN_vkDestroyDebugUtilsMessengerEXT>(
        instance.handle, "vkDestroyDebugUtilsMessengerEXT")(instance.handle, instance.messenger,
                                                            nullptr);
  }
  function_of<PFN_vkDestroyInstance>(instance.handle, "vkDestroyInstance")(instance.handle,
                                                                           nullptr);
}

}  // namespace stgs::tools
