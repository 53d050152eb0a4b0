// SPDX-License-Identifier: Apache-2.0
// The least Vulkan that runs one compute shader over two storage buffers, headless.
#ifndef STGS_TESTS_VULKAN_COMPUTE_H
#define STGS_TESTS_VULKAN_COMPUTE_H

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace stgs::test {

class VulkanCompute {
 public:
  VulkanCompute();
  ~VulkanCompute();
  VulkanCompute(const VulkanCompute&) = delete;
  VulkanCompute& operator=(const VulkanCompute&) = delete;

  // Why nothing can be run: no loader, no instance, no device. Empty where it can.
  const std::string& missing() const;
  // Names of the devices with a compute queue.
  const std::vector<std::string>& devices() const;
  // Lanes of a subgroup of one of them.
  std::uint32_t subgroup_size(std::size_t index) const;
  // Whether the Khronos validation layer, synchronisation validation included, is on.
  bool validated() const;
  // What the layer said so far: warnings and errors.
  const std::vector<std::string>& messages() const;

  // Runs `spirv` (entry point main, storage buffers at bindings 0 and 1 of set 0) once on
  // device `index` and copies binding 1 back into `output`. Returns an error message or "".
  std::string run(std::size_t index, std::span<const std::uint32_t> spirv,
                  std::span<const std::byte> input, std::span<std::byte> output,
                  std::uint32_t groups);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace stgs::test

#endif
