// SPDX-License-Identifier: Apache-2.0
// A minimal headless Vulkan host that runs one compute shader over storage buffers.
#ifndef STGS_TESTS_VULKAN_COMPUTE_H
#define STGS_TESTS_VULKAN_COMPUTE_H

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace stgs::test {

// A storage buffer as large as the longer of the two, at least 4 bytes.
struct ComputeBuffer {
  std::span<const std::byte> input;  // its first bytes; the others are 0
  std::span<std::byte> output;       // receives its first bytes afterwards
};

class VulkanCompute {
 public:
  VulkanCompute();
  ~VulkanCompute();
  VulkanCompute(const VulkanCompute&) = delete;
  VulkanCompute& operator=(const VulkanCompute&) = delete;

  // Returns why nothing can run (no loader, no instance, no device); empty if a device is usable.
  const std::string& missing() const;
  // Returns the names of the devices with a compute queue.
  const std::vector<std::string>& devices() const;
  // Returns the subgroup size of a device, in lanes.
  std::uint32_t subgroup_size(std::size_t index) const;
  // Returns whether the Khronos validation layer is active, including synchronisation validation.
  bool validated() const;
  // Returns the warnings and errors that the validation layer has reported.
  const std::vector<std::string>& messages() const;

  // Runs `spirv` (entry point main, storage buffers at the first bindings of set 0) once on device
  // `index`. Returns an error message or "".
  std::string run(std::size_t index, std::span<const std::uint32_t> spirv,
                  std::span<const ComputeBuffer> buffers, std::uint32_t groups);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace stgs::test

#endif
