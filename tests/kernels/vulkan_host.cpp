// SPDX-License-Identifier: Apache-2.0
#include "vulkan_host.h"

#include <cstdio>
#include <cstdlib>

#include "catch_runner.h"

namespace stgs::testing {
namespace {

VulkanHost* shared_host = nullptr;

void must(const Status& status) {
  if (status.ok()) return;
  std::fprintf(stderr, "%s\n", status.message().c_str());
  std::exit(1);
}

}  // namespace

std::vector<std::string>& VulkanHost::messages() {
  static std::vector<std::string> all;
  return all;
}

std::unique_ptr<VulkanHost> VulkanHost::make(bool features) {
  static const std::function<void(const std::string&)> add = [](const std::string& message) {
    messages().push_back(message);
  };
  if (volkInitialize() != VK_SUCCESS) return nullptr;
  std::unique_ptr<VulkanHost> made(new VulkanHost);
  tools::InstanceSettings settings;
  settings.api_version = VK_API_VERSION_1_2;
  settings.on_message = &add;
  if (made->host_.make_instance(settings) != VK_SUCCESS) return nullptr;
  return made->open(features) ? std::move(made) : nullptr;
}

bool VulkanHost::open(bool features) {
  const tools::DeviceHandles& handles = host_.device();
  const auto devices = tools::physical_devices(handles.instance);
  if (!devices.ok() || devices->empty()) return false;
  const int family = tools::find_queue_family(devices->front(), VK_QUEUE_COMPUTE_BIT);
  if (family < 0) return false;
  const auto offered =
      player::vulkan_support(nullptr, handles.instance, handles.api_version, devices->front());
  if (!offered.ok()) return false;
  const Status opened = host_.open({devices->front(),
                                    static_cast<std::uint32_t>(family),
                                    {},
                                    features,
                                    features && offered->subgroup_size_control});
  if (!opened.ok()) return false;
  lent_.instance = handles.instance;
  lent_.api_version = handles.api_version;
  lent_.physical_device = handles.physical_device;
  lent_.device = handles.device;
  lent_.queue = handles.queue;
  lent_.queue_family = handles.queue_family;
  lent_.features = &host_.features();
  lent_.extensions = host_.extensions();
  return true;
}

VulkanHost::~VulkanHost() {
  if (device().device == VK_NULL_HANDLE) return;
  vkDeviceWaitIdle(device().device);
  for (const VkSemaphore one : semaphores_) vkDestroySemaphore(device().device, one, nullptr);
}

HostImage VulkanHost::make_image(VkFormat format, std::uint32_t width, std::uint32_t height,
                                 std::uint32_t levels, std::uint32_t layers) {
  tools::DeviceImage& image = images_.emplace_back();
  must(image.create(host_.device(), {format, width, height, levels, layers},
                    VK_IMAGE_USAGE_TRANSFER_DST_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT));
  return {image.handle(), format, width, height};
}

std::vector<std::uint8_t> VulkanHost::read(const HostImage& image, VkImageLayout layout,
                                           std::uint32_t pixel_bytes, std::uint32_t level,
                                           std::uint32_t layer) {
  VkBufferImageCopy region = tools::whole_image(image.width >> level, image.height >> level);
  region.imageSubresource.mipLevel = level;
  region.imageSubresource.baseArrayLayer = layer;
  const std::size_t bytes =
      std::size_t{pixel_bytes} * region.imageExtent.width * region.imageExtent.height;
  tools::MappedBuffer buffer;
  must(buffer.ensure(host_.device(), VK_BUFFER_USAGE_TRANSFER_DST_BIT, bytes));
  // The barrier states the same layout before and after: the validation layer reports if it is
  // wrong.
  VkImageMemoryBarrier change = tools::image_barrier(image.image, level, layer);
  change.srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT;
  change.dstAccessMask = VK_ACCESS_TRANSFER_READ_BIT;
  change.oldLayout = layout;
  change.newLayout = layout;
  must(tools::run_commands(host_.device(), [&](VkCommandBuffer commands) {
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT,
                         VK_PIPELINE_STAGE_TRANSFER_BIT, 0, 0, nullptr, 0, nullptr, 1, &change);
    vkCmdCopyImageToBuffer(commands, image.image, layout, buffer.handle(), 1, &region);
  }));
  return {buffer.data(), buffer.data() + bytes};
}

VkSemaphore VulkanHost::make_timeline(std::uint64_t value) {
  auto type =
      tools::structure<VkSemaphoreTypeCreateInfo>(VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO);
  type.semaphoreType = VK_SEMAPHORE_TYPE_TIMELINE;
  type.initialValue = value;
  auto info = tools::structure<VkSemaphoreCreateInfo>(VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO);
  info.pNext = &type;
  VkSemaphore semaphore = VK_NULL_HANDLE;
  must(tools::vk_status(vkCreateSemaphore(device().device, &info, nullptr, &semaphore),
                        "creating a semaphore"));
  semaphores_.push_back(semaphore);
  return semaphore;
}

void VulkanHost::signal(VkSemaphore semaphore, std::uint64_t value) {
  auto info = tools::structure<VkSemaphoreSignalInfo>(VK_STRUCTURE_TYPE_SEMAPHORE_SIGNAL_INFO);
  info.semaphore = semaphore;
  info.value = value;
  must(tools::vk_status(vkSignalSemaphore(device().device, &info), "signalling a semaphore"));
}

std::uint64_t VulkanHost::value_of(VkSemaphore semaphore) {
  std::uint64_t value = 0;
  must(tools::vk_status(vkGetSemaphoreCounterValue(device().device, semaphore, &value),
                        "reading a semaphore"));
  return value;
}

VulkanHost& host() {
  return *shared_host;
}

int run_vulkan_cases(int argc, char** argv) {
  auto made = VulkanHost::make(true);
  if (made == nullptr) {
    std::printf("skipped: there is no Vulkan device with timeline semaphores\n");
    return 77;
  }
  shared_host = made.get();
  const int failed = run_cases(argc, argv);
  made.reset();
  const std::vector<std::string>& messages = VulkanHost::messages();
  for (const std::string& message : messages) std::printf("%s\n", message.c_str());
  return failed != 0 ? failed : static_cast<int>(!messages.empty());
}

}  // namespace stgs::testing
