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

// Copies an image to `out`, row by row without gaps, and waits for the copy. The device of the
// memory must be current. kUsage for memory of the host or of another device; kUnsupported without
// a device; kNotBuilt in a build without CUDA. Thread-safe.
Status copy_from_device(const DeviceRows& image, std::uint8_t* out);

}  // namespace stgs::encoder
