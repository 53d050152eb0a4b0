// SPDX-License-Identifier: Apache-2.0
// train/densify.h on the device: the same decisions, in the same order, from the same random
// numbers. The host reads a few counts, nothing of the size of the scene.
#pragma once

#include "backend/cuda/densify_kernels.h"
#include "backend/cuda/device_state.h"
#include "backend/cuda/memory.h"
#include "train/densify.h"

namespace stgs::encoder::cuda {

class Densifier {
 public:
  Status create();
  // Between steps: uses the step's buffers for its own. Waits for the stream.
  Result<DensifyCounts> grow(DeviceState& state, const HyperParameters& parameters,
                             const DensifyContext& context, std::uint64_t iteration,
                             const Workspace& w, cudaStream_t stream);
  Result<DensifyCounts> replace(DeviceState& state, const HyperParameters& parameters,
                                const DensifyContext& context, std::uint64_t iteration,
                                const Workspace& w, cudaStream_t stream);

 private:
  Status clear_totals(cudaStream_t stream);
  Result<DensifyTotals> read_totals(cudaStream_t stream);
  Status keep(DeviceState& state, std::size_t kept, const Workspace& w, cudaStream_t stream);
  Status reset_statistics(const Primitives& p, cudaStream_t stream);

  DeviceArray<DensifyTotals> totals_;
  PinnedArray<DensifyTotals> read_;
};

}  // namespace stgs::encoder::cuda
