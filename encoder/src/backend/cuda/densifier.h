// SPDX-License-Identifier: Apache-2.0
// train/densify.h on the device, with the same decisions in the same order from the same random
// numbers. The host reads only a few counts.
#pragma once

#include "backend/cuda/densify_kernels.h"
#include "backend/cuda/device_state.h"
#include "backend/cuda/memory.h"
#include "train/densify.h"

namespace stgs::encoder::cuda {

class Densifier {
 public:
  // Allocates the counters.
  Status create();
  // grow() and replace() of train/densify.h and relocate() of train/relocation.h. Call between
  // steps, because they reuse the buffers of the step. Block until the stream has finished.
  Result<DensifyCounts> grow(DeviceState& state, const HyperParameters& parameters,
                             const DensifyContext& context, std::uint64_t iteration,
                             const Workspace& w, cudaStream_t stream);
  Result<DensifyCounts> replace(DeviceState& state, const HyperParameters& parameters,
                                const DensifyContext& context, std::uint64_t iteration,
                                const Workspace& w, cudaStream_t stream);
  Result<DensifyCounts> relocate(DeviceState& state, const HyperParameters& parameters,
                                 const DensifyContext& context, std::uint64_t iteration,
                                 const Workspace& w, cudaStream_t stream);

 private:
  Status clear_totals(cudaStream_t stream);
  Result<DensifyTotals> read_totals(cudaStream_t stream);
  Status compact(DeviceState& state, std::size_t survivors, const Workspace& w,
                 cudaStream_t stream);
  Status reset_statistics(const Primitives& p, cudaStream_t stream);

  DeviceArray<DensifyTotals> totals_;
  PinnedArray<DensifyTotals> host_totals_;
};

}  // namespace stgs::encoder::cuda
