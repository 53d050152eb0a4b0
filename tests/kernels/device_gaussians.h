// SPDX-License-Identifier: Apache-2.0
// Primitives in GPU memory, for the test and the benchmark of the CUDA segment decoder.
#pragma once

#include "cuda/segment_decode.h"
#include "rans_device.h"
#include "stgs/format/gaussian4d.h"

namespace stgs::testing {

class DeviceGaussianArrays {
 public:
  // Filled with -7, a value that no test decodes.
  DeviceGaussianArrays(std::size_t n, int sh_degree) {
    set_.sh_degree = sh_degree;
    set_.resize(n);
    for (FloatArray* array : arrays(set_)) {
      arrays_.emplace_back(std::vector<float>(array->size(), -7.0f));
    }
  }
  player::cuda::DeviceGaussians view() const {
    return {arrays_[0].data(), arrays_[1].data(), arrays_[2].data(),
            arrays_[3].data(), arrays_[4].data(), arrays_[5].data(),
            arrays_[6].data(), arrays_[7].data(), arrays_[8].data()};
  }
  Gaussians4D read() const {
    Gaussians4D out = set_;
    const auto out_arrays = arrays(out);
    for (std::size_t k = 0; k < out_arrays.size(); ++k) {
      const std::vector<float> values = arrays_[k].read();
      out_arrays[k]->assign(values.begin(), values.end());
    }
    return out;
  }
  static std::array<FloatArray*, 9> arrays(Gaussians4D& set) {
    return {&set.position, &set.log_scale, &set.rotation, &set.opacity_logit, &set.sh,
            &set.time,     &set.velocity,  &set.sigma,    &set.radius};
  }

 private:
  Gaussians4D set_;
  std::vector<DeviceValues<float>> arrays_;
};

}  // namespace stgs::testing
