// SPDX-License-Identifier: Apache-2.0
// The CUDA training backend. The complete state resides on the GPU from begin() to synchronise(),
// also during densification, and steps are enqueued without waiting for previous ones.
//
// The capacity for tile instances is derived from previous steps. A step that needs more has no
// effect, and neither do those after it. When the host detects this, a few steps later, it
// increases the capacity and repeats them. The result of a run therefore never depends on timing:
// on the same GPU and build, the same start gives the same bits.
#pragma once

#include <array>
#include <deque>
#include <memory>
#include <optional>

#include "backend/backend.h"
#include "backend/cuda/densifier.h"
#include "backend/cuda/device_state.h"
#include "backend/cuda/ground_truth_cache.h"
#include "backend/cuda/step_pipeline.h"

namespace stgs::encoder::cuda {

class CudaBackend final : public TrainBackend {
 public:
  ~CudaBackend() override;

  // Initialises device `gpu` modulo the number of devices; kUnsupported if there is none.
  Status create(int gpu = 0);
  // Like TrainBackend::join, with the given exchange instead of NCCL's.
  Status join(Ranks& ranks, std::unique_ptr<RankExchange> exchange);

  Status join(Ranks& ranks) override;
  Status check_perceptual() const override { return check_perceptual_network(); }
  Status reserve(const TrainPlan& plan) override;
  Status begin(TrainState& state) override;
  Status step(const StepInput& input) override;
  Result<DensifyCounts> densify(const DensifyInput& input) override;
  std::size_t size() const override { return device_.primitives().n; }
  Result<std::vector<StepOutput>> read() override;
  Status synchronise() override;
  Status limit_scales(std::span<const math::PinholeCamera> cameras, float pixels) override;
  std::size_t abandon() override;
  Result<std::optional<std::vector<float>>> importance(
      std::span<const ImportanceView> views,
      const std::function<bool(double)>& should_continue) override;
  std::string name() const override { return name_; }

  // For tests and benchmarks.
  StepPipeline& pipeline() { return pipeline_; }
  cudaStream_t stream() const { return stream_; }
  // Returns the largest number of tile instances of recent steps (a slowly decaying maximum).
  std::size_t max_recent_instances() const { return recent_instances_; }
  // Returns the number of steps repeated because the capacity for tile instances was too small.
  std::size_t retried_steps() const { return retried_steps_; }

 private:
  static constexpr std::size_t kMaxInFlight = 32;      // steps
  static constexpr std::size_t kImportanceBatch = 16;  // views between waits for the GPU
  // The limit for several ranks. They read a step's record when so many are in flight, not when it
  // becomes available, so that all detect an overflow at the same step.
  static constexpr std::size_t kMaxSharedInFlight = 16;
  struct PendingStep {
    StepInput input;
    std::size_t slot;  // of its record and event
  };

  // Whether the memory reserved before suffices for a plan.
  bool has_reserved(const TrainPlan& plan) const;
  // Returns kRuntime if a view exceeds the limit of tile instances.
  static Status check_instances(std::size_t instances);
  Status enqueue(const StepInput& input);
  // Reserves memory for a step and returns its capacity in tile instances. Evicts cached images if
  // memory is short.
  Result<std::size_t> reserve_step(const StepInput& input);
  // Assigns most of the free memory to the image cache.
  Status resize_image_cache();
  // Takes the outputs of the oldest step, which has completed without overflow.
  void retire_oldest();
  const StepRecord& own_record(std::size_t slot) const;
  // Retires completed steps and retries after an overflow. `wait`: waits for all steps.
  Status collect(bool wait);
  // Waits for a step while polling for the failure of another rank.
  Status wait_shared(std::size_t slot);
  std::size_t ranks() const {
    return ranks_ == nullptr ? 1 : static_cast<std::size_t>(ranks_->size());
  }
  // The oldest pending step overflowed with `instances`: increases the capacity and repeats all
  // pending steps.
  Status retry(std::size_t instances);
  // Adds the importances of views, at most kImportanceBatch, to `sums`. Returns how many it added,
  // from the first on: fewer if the capacity did not suffice, which is then increased.
  Result<std::size_t> add_importances(std::span<const ImportanceView> views,
                                      unsigned long long* sums);
  Status enqueue_importances(std::span<const ImportanceView> views, unsigned long long* sums);
  // Returns the capacity to reserve for a step, tile instances.
  std::size_t instance_capacity() const;

  std::string name_;
  std::optional<TrainPlan> reserved_;
  Ranks* ranks_ = nullptr;  // null: this process trains alone
  std::unique_ptr<RankExchange> exchange_;
  Stream stream_;
  DeviceState device_;
  StepPipeline pipeline_;
  Densifier densifier_;
  GroundTruthCache image_cache_;
  DeviceArray<math::PinholeCamera> cameras_;  // of limit_scales()
  PinnedArray<StepRecord> records_;           // for each slot, one per rank
  std::array<Event, kMaxInFlight> done_;
  PinnedArray<Counters> view_counters_;  // of importances
  std::deque<PendingStep> pending_;      // oldest first
  std::size_t next_slot_ = 0;
  std::size_t dropped_steps_ = 0;    // pending steps that an error prevented from being retried
  std::vector<StepOutput> outputs_;  // since the last read()
  TrainState* state_ = nullptr;
  std::size_t recent_instances_ = 0, retried_steps_ = 0;
};

}  // namespace stgs::encoder::cuda
