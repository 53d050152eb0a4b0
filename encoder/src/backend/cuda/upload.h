// SPDX-License-Identifier: Apache-2.0
// Uploads of several arrays.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "backend/cuda/memory.h"

namespace stgs::encoder::cuda {

// Arrays of the host, one after the other on the device.
template <typename T>
class Uploaded {
 public:
  // Starts again, for arrays of `total` values together.
  Status start(std::size_t total) {
    used_ = 0;
    return array_.ensure(std::max<std::size_t>(total, 1));
  }
  // Copies an array, which must outlive the copy, and sets its address on the device.
  Status add(const T* values, std::size_t n, cudaStream_t stream, const T** out) {
    *out = array_.data() + used_;
    used_ += n;
    return cuda_status(cudaMemcpyAsync(array_.data() + used_ - n, values, n * sizeof(T),
                                       cudaMemcpyHostToDevice, stream),
                       "uploading a frame");
  }
  Status set(const std::vector<T>& values, cudaStream_t stream) {
    const T* address = nullptr;
    STGS_TRY(start(values.size()));
    return add(values.data(), values.size(), stream, &address);
  }
  T* data() const { return array_.data(); }

 private:
  DeviceArray<T> array_;
  std::size_t used_ = 0;
};

}  // namespace stgs::encoder::cuda
