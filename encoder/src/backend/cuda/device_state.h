// SPDX-License-Identifier: Apache-2.0
// A TrainState on the GPU, with upload and download.
#pragma once

#include <cstdint>
#include <vector>

#include "backend/cuda/kernels.h"
#include "backend/cuda/memory.h"
#include "train/train_state.h"

namespace stgs::encoder::cuda {

// Primitives are appended and removed in place: every array has the reserved capacity.
class DeviceState {
 public:
  // An array with one entry per primitive, in 4-byte words.
  struct Array {
    std::uint32_t* data;
    int words;  // per primitive
  };

  // Returns the device memory for n primitives, bytes.
  static std::size_t bytes(std::size_t n, int sh_coefficients, bool coupled, bool rounding);

  // Allocates memory for up to n primitives, so that uploads do not allocate.
  Status reserve(std::size_t n, int sh_coefficients, bool coupled);
  // Allocates memory for the rounded values of up to n primitives, after reserve().
  Status reserve_rounding(std::size_t n);
  // Copies the state to the device. `state` may be changed on return, although the copy on the
  // stream may still be in flight.
  Status upload(const TrainState& state, cudaStream_t stream);
  // Copies the state to the host, resizing `state`. Blocks until done.
  Status download(TrainState& state, cudaStream_t stream);
  // Sets the number of primitives, at most capacity().
  void resize(std::size_t n) { primitives_.n = static_cast<std::uint32_t>(n); }

  std::size_t capacity() const { return capacity_; }
  const Primitives& primitives() const { return primitives_; }
  // Renews the rounded values after a change of the learnt ones, if the state is being rounded.
  void round(cudaStream_t stream) const {
    if (primitives_.rules != nullptr) launch_rounding(primitives_, rounded_, stream);
  }
  const ColourMaps& colour() const { return colour_; }
  const std::vector<Array>& arrays() const { return arrays_; }

 private:
  // Returns the host arrays that correspond to arrays(), in the same order.
  static std::vector<std::uint32_t*> host_arrays(TrainState& state);
  static std::vector<ColourMap>* colour_arrays(TrainState& state, int which);
  // Returns the learnt values, in the coupled form the derived ones.
  Rendered learnt() const;
  Status upload_rounding(const TrainState& state, cudaStream_t stream);
  Status upload_colour(const TrainState& state, cudaStream_t stream);
  Status download_colour(TrainState& state);

  std::size_t capacity_ = 0;
  bool coupled_ = false;  // the layout
  DeviceArray<std::uint32_t> memory_, colour_memory_;
  PinnedArray<std::uint32_t> staging_;
  std::vector<Array> arrays_;
  Primitives primitives_;
  ColourMaps colour_;
  RoundedValues rounded_;
  DeviceArray<float> rounded_memory_;
  DeviceArray<RoundingRules> rules_memory_;
  DeviceArray<std::uint8_t> tier_memory_;
};

}  // namespace stgs::encoder::cuda
