// SPDX-License-Identifier: Apache-2.0
// The kernels of one step, or of weighing at one view, in their order, and the buffers between
// them.
#pragma once

#include <functional>

#include "backend/backend.h"
#include "backend/cuda/device_state.h"
#include "backend/cuda/kernels.h"
#include "backend/cuda/memory.h"
#include "backend/cuda/perceptual_network.h"
#include "backend/cuda/rank_blocks.h"
#include "backend/cuda/rank_exchange.h"

namespace stgs::encoder::cuda {

class StepPipeline {
 public:
  // Called with a stage's name when all its work and that of the stages before is enqueued.
  using StageObserver = std::function<void(const char* stage)>;

  // Bytes of device memory for such steps.
  static std::size_t bytes(std::size_t primitives, int width, int height, std::size_t instances,
                           bool planes);

  Status create(cudaStream_t stream);
  // Memory for steps of this size, from now on also with planes (L_n) where it says so; waits for
  // the stream where it has to grow. Lists grow by more than asked for where there is room; bytes()
  // are enough.
  Status reserve(std::size_t primitives, int width, int height, std::size_t instances, bool planes,
                 cudaStream_t stream);
  // Enqueues a step with room for `instances` tile instances; the size is reserved. `record`, one
  // a rank, is mapped host memory as the device addresses it.
  Status enqueue(const DeviceState& state, const StepInput& input, const std::uint8_t* truth,
                 std::size_t instances, StepRecord* record, cudaStream_t stream);
  // Weighs the primitives at the camera and moment of `input`: adds to `sums`, one a primitive in
  // units of 1 / kImportanceOne. Where there was no room it adds nothing, and what it returns has
  // overflow set. Waits.
  Result<Counters> weigh(const DeviceState& state, const StepInput& input, std::size_t instances,
                         unsigned long long* sums, cudaStream_t stream);
  // For steps with a perceptual loss; reserved for their patches. Null: there are none.
  void set_perceptual(std::unique_ptr<PerceptualNetwork> network);
  // For steps with a batch: the ranks' exchange, which is not owned. `primitives` at most.
  Status set_ranks(const Ranks& ranks, RankExchange* exchange, std::size_t primitives);
  // Lets steps change the state again after an overflow.
  Status clear_overflow(cudaStream_t stream);

  void observe(StageObserver observer) { observer_ = std::move(observer); }
  // The device buffers, as the last step left them.
  const Workspace& workspace() const { return workspace_; }

 private:
  Status reserve_lists(std::size_t instances, cudaStream_t stream);
  Status release_lists(cudaStream_t stream);
  Status reserve_primitives(std::size_t n);
  Status reserve_picture(int width, int height);
  Status reserve_instances(std::size_t n);
  Status reserve_segments();
  Status reserve_planes();
  // The end of a step of several ranks.
  Status enqueue_shared(const DeviceState& state, const StepInput& input, const View& view,
                        const LossWeights& weights, StepRecord* records, cudaStream_t stream);
  // After the image loss.
  Status enqueue_perceptual(const StepInput& input, const View& view, const std::uint8_t* truth,
                            const float* colour_map, cudaStream_t stream);
  void stage(const char* name) {
    if (observer_) observer_(name);
  }

  StageObserver observer_;
  std::unique_ptr<PerceptualNetwork> perceptual_;
  Workspace workspace_;
  RankExchange* exchange_ = nullptr;
  RankBlocks blocks_;  // but for their size
  DeviceArray<std::uint8_t> block_memory_;
  DeviceArray<Counters> counters_;
  DeviceArray<std::uint32_t> iota_;
  DeviceArray<ScreenSplat> splats_;
  DeviceArray<std::uint32_t> depth_keys_, depth_sorted_, order_, tile_counts_, tile_masks_,
      tile_offsets_;
  DeviceArray<uint2> ranges_;
  DeviceArray<std::uint32_t> owners_, instance_tiles_, tiles_sorted_, instances_sorted_, list_;
  DeviceArray<std::uint32_t> tile_begin_, last_;
  DeviceArray<float> partials_, slopes_, error_, ssim_sums_, loss_sums_;
  DeviceArray<uint2> segments_;
  DeviceArray<float4> picture_, d_picture_, checkpoints_;
  DeviceArray<double> regulariser_sums_;
  DeviceArray<std::uint8_t> sort_memory_;
  bool with_planes_ = false;
  DeviceArray<float4> planes_, surface_, surface_checkpoints_, d_surface_, plane_partials_;
  DeviceArray<std::uint32_t> difference_range_;
  DeviceArray<float> normal_sums_;
};

}  // namespace stgs::encoder::cuda
