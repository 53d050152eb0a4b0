// SPDX-License-Identifier: Apache-2.0
// Images in the memory of a CUDA device.
#pragma once

#include <cstddef>
#include <cstdint>

#include "stgs/format/status.h"

struct CUstream_st;  // cudaStream_t is a pointer to it

namespace stgs::encoder {

// Rows of bytes on a CUDA device.
struct DeviceRows {
  const void* data = nullptr;
  std::size_t stride = 0;               // bytes between rows
  std::size_t row_bytes = 0, rows = 0;  // of the image
  CUstream_st* stream = nullptr;        // in whose order the image is complete; null: the default
};

// The CUDA device that is current on this thread when it is made is current again when it is
// destroyed. Does nothing in a build without CUDA.
class KeptDevice {
 public:
  KeptDevice();
  ~KeptDevice();
  KeptDevice(const KeptDevice&) = delete;
  KeptDevice& operator=(const KeptDevice&) = delete;

 private:
  int device_ = -1;  // none
};

// Copies an image to `out`, row by row without gaps, and waits for the copy. kUsage for memory of
// the host; kUnsupported without a device; kNotBuilt in a build without CUDA. Thread-safe.
Status copy_from_device(const DeviceRows& image, std::uint8_t* out);

}  // namespace stgs::encoder
