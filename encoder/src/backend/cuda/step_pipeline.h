// SPDX-License-Identifier: Apache-2.0
// Runs the kernels of a step, or of the importances of a view, in order, and owns the buffers
// between them.
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
  // Called with the name of a stage when its work and that of all previous stages is enqueued.
  using StageObserver = std::function<void(const char* stage)>;

  // Returns the device memory for steps of this size, bytes.
  static std::size_t bytes(std::size_t primitives, int width, int height, std::size_t instances,
                           bool planes);

  // Allocates the counters.
  Status create(cudaStream_t stream);
  // Reserves memory for steps of this size. `planes`: also for L_n from now on. Waits for the
  // stream if anything grows. Lists grow by more than requested if memory permits; bytes()
  // suffices.
  Status reserve(std::size_t primitives, int width, int height, std::size_t instances, bool planes,
                 cudaStream_t stream);
  // Enqueues a step with a capacity of `instances` tile instances, within the reserved size.
  // `record`: device address of mapped host memory, one record per rank.
  Status enqueue(const DeviceState& state, const StepInput& input, const std::uint8_t* ground_truth,
                 std::size_t instances, StepRecord* record, cudaStream_t stream);
  // Enqueues adding the importances at the camera and time of `input` to `sums`, one per primitive,
  // in units of 1 / kImportanceOne, then copying the counters to `counters`, of page-locked memory.
  // If the capacity is too small for it or an earlier view, adds nothing and sets the overflow.
  Status enqueue_importance(const DeviceState& state, const StepInput& input, std::size_t instances,
                            unsigned long long* sums, Counters* counters, cudaStream_t stream);
  // Sets the network for steps with a perceptual loss, which must have reserved their patch size;
  // null: none.
  void set_perceptual(std::unique_ptr<PerceptualNetwork> network);
  // Sets the ranks' exchange (not owned) for steps with a batch. `primitives`: the maximum.
  Status set_ranks(const Ranks& ranks, RankExchange* exchange, std::size_t primitives);
  // Re-enables steps and importances after an overflow.
  Status clear_overflow(cudaStream_t stream);

  // Sets a function called after each stage.
  void observe(StageObserver observer) { observer_ = std::move(observer); }
  // Returns the device buffers, as the latest step left them.
  const Workspace& workspace() const { return workspace_; }

 private:
  Status reserve_lists(std::size_t instances);
  Status release_lists(cudaStream_t stream);
  Status reserve_primitives(std::size_t n, cudaStream_t stream);
  Status reserve_sort(std::size_t n, cudaStream_t stream);
  Status reserve_image(int width, int height, cudaStream_t stream);
  Status reserve_instances(std::size_t n);
  Status reserve_segments();
  Status reserve_planes();
  // Enqueues the end of a step of several ranks.
  Status enqueue_shared(const DeviceState& state, const StepInput& input, const View& view,
                        const LossWeights& weights, StepRecord* records, cudaStream_t stream);
  // Enqueues the perceptual loss, after the image loss.
  Status enqueue_perceptual(const StepInput& input, const View& view,
                            const std::uint8_t* ground_truth, const float* colour_map,
                            cudaStream_t stream);
  void stage(const char* name) {
    if (observer_) observer_(name);
  }

  StageObserver observer_;
  std::unique_ptr<PerceptualNetwork> perceptual_;
  Workspace workspace_;
  RankExchange* exchange_ = nullptr;
  RankBlocks blocks_;  // without their size
  DeviceArray<std::uint8_t> block_memory_;
  DeviceArray<Counters> counters_;
  DeviceArray<std::uint32_t> iota_;
  DeviceArray<ScreenSplat> splats_;
  DeviceArray<std::uint32_t> depth_keys_, keys_sorted_, order_, flags_, offsets_, block_begin_;
  DeviceArray<uint2> ranges_;
  DeviceArray<unsigned long long> entry_keys_;
  DeviceArray<std::uint32_t> instances_sorted_, list_;
  DeviceArray<std::uint32_t> tile_begin_, tile_entries_, last_;
  DeviceArray<float> partials_, slopes_, error_, ssim_sums_, loss_sums_;
  DeviceArray<uint2> segments_;
  DeviceArray<float4> image_, d_image_, checkpoints_, sums_;
  DeviceArray<double> regulariser_sums_;
  DeviceArray<float> camera_sums_, lens_sums_;
  DeviceArray<std::uint8_t> without_lens_;
  DeviceArray<std::uint8_t> sort_memory_;
  bool with_planes_ = false;
  DeviceArray<float4> planes_, surface_, surface_checkpoints_, d_surface_, plane_partials_,
      plane_sums_;
  DeviceArray<std::uint32_t> difference_range_;
  DeviceArray<float> normal_sums_;
};

}  // namespace stgs::encoder::cuda
