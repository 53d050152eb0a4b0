// SPDX-License-Identifier: Apache-2.0
// The CUDA training backend: the whole state is on the GPU from begin() to synchronise(), also
// while it is densified, and a step is enqueued without waiting for the one before.
//
// The buffers for tile instances have a size that follows from the steps before. A step that needs
// more changes nothing, and neither do those after it; when the host learns of it, a few steps
// later, it makes room and does them again. A run therefore never depends on timing: on the same
// GPU and build, the same start gives the same bits.
#pragma once

#include <array>
#include <deque>
#include <memory>

#include "backend/backend.h"
#include "backend/cuda/densifier.h"
#include "backend/cuda/device_state.h"
#include "backend/cuda/ground_truth_cache.h"
#include "backend/cuda/step_pipeline.h"

namespace stgs::encoder::cuda {

class CudaBackend final : public TrainBackend {
 public:
  ~CudaBackend() override;

  // Sets up a device, `gpu` modulo their number; kUnsupported where there is none.
  Status create(int gpu = 0);
  // As TrainBackend::join, with an exchange that is not NCCL's.
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
  std::size_t abandon() override;
  Result<std::optional<std::vector<float>>> importance(
      std::span<const ImportanceView> views, const std::function<bool(double)>& go_on) override;
  std::string name() const override { return name_; }

  StepPipeline& pipeline() { return pipeline_; }
  cudaStream_t stream() const { return stream_; }
  // Largest number of tile instances of late.
  std::size_t max_recent_instances() const { return instances_seen_; }
  // Steps that were done again because there had been too little room.
  std::size_t retried_steps() const { return redone_; }

 private:
  // Steps on their way to the GPU, at most.
  static constexpr std::size_t kInFlight = 32;
  // The same for several ranks, who look at a step's record when so many are under way, and not
  // when it happens to be there: all learn of an overflow at the same step.
  static constexpr std::size_t kSharedInFlight = 16;
  struct Pending {
    StepInput input;
    std::size_t slot;  // of its record and event
  };

  Status enqueue(const StepInput& input);
  // Room for a step, in tile instances. The pictures on the device make way where there is too
  // little.
  Result<std::size_t> reserve_step(const StepInput& input);
  Status share_with_pictures();
  // Takes what the oldest step has left, which is done and has fitted.
  void take_oldest();
  const StepRecord& own_record(std::size_t slot) const;
  // Takes what the oldest steps have left; waits for all of them, or only for those that are done.
  Status collect(bool wait);
  // Waits for a step, and meanwhile looks whether another rank has failed.
  Status wait_shared(std::size_t slot);
  std::size_t ranks() const {
    return ranks_ == nullptr ? 1 : static_cast<std::size_t>(ranks_->size());
  }
  Status redo(std::size_t instances);
  // Adds a view's to `sums`, again and again until there is room for its tile instances.
  Status weigh(const ImportanceView& view, unsigned long long* sums);
  std::size_t room() const;

  std::string name_;
  Ranks* ranks_ = nullptr;  // null: alone
  std::unique_ptr<RankExchange> exchange_;
  Stream stream_;
  DeviceState device_;
  StepPipeline pipeline_;
  Densifier densifier_;
  GroundTruthCache truths_;
  PinnedArray<StepRecord> records_;  // for each slot, one a rank
  std::array<Event, kInFlight> done_;
  std::deque<Pending> pending_;  // oldest first
  std::size_t next_slot_ = 0;
  std::size_t lost_ = 0;             // steps that an error has kept from being done again
  std::vector<StepOutput> outputs_;  // since the last read()
  TrainState* state_ = nullptr;
  std::size_t instances_seen_ = 0, redone_ = 0;
};

}  // namespace stgs::encoder::cuda
