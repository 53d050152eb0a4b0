// SPDX-License-Identifier: Apache-2.0
// Uploads of several arrays.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "backend/cuda/memory.h"

namespace stgs::encoder::cuda {

// Arrays of the host, one after the other on the device.
template <typename T>
class Uploaded {
 public:
  // `what`: a plural noun for the values, in errors.
  explicit Uploaded(const char* what) : what_(what) {}

  // Starts again, for arrays of `total` values together.
  Status start(std::size_t total) {
    used_ = 0;
    const Status status = array_.ensure(std::max<std::size_t>(total, 1));
    if (status.ok()) return {};
    return {status.code(), fmt::format("{}: {}", what_, status.message())};
  }
  // Copies an array, which must outlive the copy, and sets its address on the device.
  Status add(const T* values, std::size_t n, cudaStream_t stream, const T** out) {
    *out = array_.data() + used_;
    used_ += n;
    const cudaError_t error = cudaMemcpyAsync(array_.data() + used_ - n, values, n * sizeof(T),
                                              cudaMemcpyHostToDevice, stream);
    return error == cudaSuccess ? Status() : cuda_status(error, ("uploading " + what_).c_str());
  }
  Status set(const std::vector<T>& values, cudaStream_t stream) {
    const T* address = nullptr;
    STGS_TRY(start(values.size()));
    return add(values.data(), values.size(), stream, &address);
  }
  T* data() const { return array_.data(); }

 private:
  const std::string what_;
  DeviceArray<T> array_;
  std::size_t used_ = 0;
};

}  // namespace stgs::encoder::cuda
