// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/cuda_backend.h"

#include <algorithm>
#include <thread>
#include <utility>

#include "backend/cuda/select_gpu.h"

namespace stgs::encoder {
namespace cuda {
namespace {

// Estimated tile instances per primitive, before the first step.
constexpr std::size_t kInstancesPerPrimitive = 6;
constexpr std::size_t kMinInstances = std::size_t{1} << 16;
// Instance capacity over the largest recent number.
constexpr double kSlack = 1.25;
// Decay of the largest recent number per step.
constexpr double kDecay = 0.999;
// Fraction of the free memory for the image cache, after everything else is allocated.
constexpr double kImageCacheFraction = 0.85;

// Returns the instance capacity before the first step.
std::size_t initial_instances(std::size_t primitives) {
  return std::clamp(kInstancesPerPrimitive * primitives, kMinInstances, kMaxInstances);
}

StepOutput output_of(const StepRecord& record, bool with_camera) {
  StepOutput output;
  output.loss = record.loss;
  output.l1 = record.l1;
  output.mse = record.mse;
  output.ssim = record.ssim;
  output.normal = record.normal;
  output.perceptual = record.perceptual;
  output.visible = record.visible;
  const float* c = record.camera;
  if (with_camera) output.camera = {{c[0], c[1], c[2]}, {c[3], c[4], c[5]}, c[6], c[7], c[8]};
  output.vignetting = record.vignetting;
  return output;
}

Status too_little_memory(const TrainPlan& plan, std::size_t need, std::size_t free,
                         std::size_t total, std::size_t perceptual) {
  const auto text = [](std::size_t bytes) { return bytes_text(static_cast<double>(bytes)); };
  return unsupported(
      "training {} primitives on {}x{} images needs {} of GPU memory, but only {} of {} are free; "
      "use "
      "fewer primitives (--max-primitives), smaller frames{} or --backend cpu",
      plan.primitives, plan.width, plan.height, text(need), text(free), text(total),
      perceptual == 0
          ? ""
          : fmt::format(", a smaller perceptual_patch (which takes {})", text(perceptual)));
}

}  // namespace

Status CudaBackend::check_instances(std::size_t instances) {
  if (instances <= kMaxInstances) return {};
  return runtime_error(
      "a view has too many tile instances ({}, at most {} supported): the primitives have grown "
      "out of bounds",
      instances, kMaxInstances);
}

CudaBackend::~CudaBackend() {
  // If another rank has failed, the GPU would wait for it forever.
  if (exchange_ && cudaStreamQuery(stream_) == cudaErrorNotReady) exchange_->abort();
  (void)stream_.wait();
}

Status CudaBackend::create(int gpu) {
  STGS_ASSIGN(const cudaDeviceProp properties, select_gpu(gpu));
  name_ = fmt::format("cuda ({})", properties.name);
  STGS_TRY(stream_.create());
  STGS_TRY(pipeline_.create(stream_));
  STGS_TRY(densifier_.create());
  STGS_TRY(records_.ensure(kMaxInFlight));
  for (Event& event : done_) STGS_TRY(event.create());
  return {};
}

Status CudaBackend::join(Ranks& ranks) {
  STGS_ASSIGN(std::unique_ptr<RankExchange> exchange, make_nccl_exchange(ranks));
  return join(ranks, std::move(exchange));
}

Status CudaBackend::join(Ranks& ranks, std::unique_ptr<RankExchange> exchange) {
  ranks_ = &ranks;
  exchange_ = std::move(exchange);
  return records_.ensure(kMaxInFlight * this->ranks());
}

bool CudaBackend::has_reserved(const TrainPlan& plan) const {
  if (!reserved_ || ranks_ != nullptr) return false;
  const TrainPlan& has = *reserved_;
  return plan.primitives <= has.primitives && plan.sh_coefficients == has.sh_coefficients &&
         plan.width <= has.width && plan.height <= has.height && plan.coupled == has.coupled &&
         plan.normals <= has.normals && plan.rounding <= has.rounding && !plan.perceptual &&
         !has.perceptual;
}

Status CudaBackend::reserve(const TrainPlan& plan) {
  STGS_TRY(collect(true));
  outputs_.clear();
  if (has_reserved(plan)) {
    image_cache_.clear();  // images of the previous window
    return {};
  }
  reserved_.reset();
  STGS_TRY(image_cache_.release_memory());
  const std::size_t pixels = std::size_t{1} * plan.width * plan.height;
  const std::size_t instances = initial_instances(plan.primitives);
  const std::size_t state_bytes =
      DeviceState::bytes(plan.primitives, plan.sh_coefficients, plan.coupled, plan.rounding);
  const std::size_t step_bytes =
      StepPipeline::bytes(plan.primitives, plan.width, plan.height, instances, plan.normals);
  const std::size_t shared_bytes = ranks_ == nullptr ? 0 : ranks() * block_bytes(plan.primitives);
  const std::size_t min_image_bytes = 16 * pixels;
  pipeline_.set_perceptual(nullptr);
  std::unique_ptr<PerceptualNetwork> perceptual;
  std::size_t perceptual_bytes = 0;
  const Patch patch = patch_size(plan.width, plan.height, plan.perceptual_patch);
  if (plan.perceptual) {
    STGS_ASSIGN(perceptual, make_perceptual_network(plan.perceptual));
    STGS_ASSIGN(perceptual_bytes, perceptual->bytes(patch.width, patch.height));
  }
  std::size_t free = 0, total = 0;
  STGS_TRY(cuda_status(cudaMemGetInfo(&free, &total), "querying GPU memory"));
  const std::size_t need =
      state_bytes + step_bytes + shared_bytes + min_image_bytes + perceptual_bytes;
  if (need > free) return too_little_memory(plan, need, free, total, perceptual_bytes);
  if (perceptual) STGS_TRY(perceptual->reserve(patch.width, patch.height));
  pipeline_.set_perceptual(std::move(perceptual));
  if (ranks_ != nullptr) {
    STGS_TRY(pipeline_.set_ranks(*ranks_, exchange_.get(), plan.primitives));
  }
  STGS_TRY(device_.reserve(plan.primitives, plan.sh_coefficients, plan.coupled));
  if (plan.rounding) STGS_TRY(device_.reserve_rounding(plan.primitives));
  // An exact fit may still fail, because the driver rounds up each allocation.
  if (!pipeline_.reserve(plan.primitives, plan.width, plan.height, instances, plan.normals, stream_)
           .ok()) {
    return too_little_memory(plan, need, free, total, perceptual_bytes);
  }
  STGS_TRY(resize_image_cache());
  reserved_ = plan;
  return {};
}

Status CudaBackend::resize_image_cache() {
  std::size_t free = 0, total = 0;
  STGS_TRY(cuda_status(cudaMemGetInfo(&free, &total), "querying GPU memory"));
  return image_cache_.create(
      static_cast<std::size_t>(kImageCacheFraction * static_cast<double>(free)));
}

Status CudaBackend::begin(TrainState& state) {
  STGS_TRY(collect(true));
  state_ = &state;
  return device_.upload(state, stream_);
}

Result<DensifyCounts> CudaBackend::densify(const DensifyInput& input) {
  STGS_TRY(collect(true));
  const std::size_t before = size();
  // Increases the capacity if reserve() was called with a smaller max_primitives.
  const std::size_t capacity =
      std::max(before, static_cast<std::size_t>(std::max(input.parameters->max_primitives, 0)));
  if (device_.capacity() < capacity) {
    STGS_TRY(synchronise());
    STGS_TRY(device_.reserve(capacity, device_.primitives().sh_coefficients, state_->is_coupled()));
    STGS_TRY(device_.upload(*state_, stream_));
  }
  STGS_TRY(pipeline_.reserve(capacity, 1, 1, initial_instances(capacity), false, stream_));
  const Workspace& w = pipeline_.workspace();
  const auto change = input.step == DensifyStep::kGrow      ? &Densifier::grow
                      : input.step == DensifyStep::kReplace ? &Densifier::replace
                                                            : &Densifier::relocate;
  STGS_ASSIGN(const DensifyCounts counts,
              (densifier_.*change)(device_, *input.parameters, input.context, state_->iteration, w,
                                   stream_));
  if (input.reset_opacity) {
    const DensifyRules rules = densify_rules(*input.parameters, input.context);
    launch_reset_opacity(device_.primitives(), reset_logit(rules), stream_);
    STGS_TRY(cuda_status(cudaGetLastError(), "resetting the opacities"));
  }
  if (state_->is_coupled()) launch_derive_coupled(device_.primitives(), stream_);
  // The number of instances grows with the number of primitives.
  if (before > 0 && size() > before) recent_instances_ = recent_instances_ * size() / before;
  return counts;
}

std::size_t CudaBackend::instance_capacity() const {
  if (recent_instances_ == 0) return initial_instances(device_.primitives().n);
  const auto target = static_cast<std::size_t>(kSlack * static_cast<double>(recent_instances_));
  return std::clamp(target, kMinInstances, kMaxInstances);
}

Status CudaBackend::step(const StepInput& input) {
  STGS_TRY(collect(false));
  // Loops, because after a retry all steps are in flight steps.
  while (pending_.size() >= kMaxInFlight) {
    STGS_TRY(cuda_status(cudaEventSynchronize(done_[pending_.front().slot]), "waiting for a step"));
    STGS_TRY(collect(false));
  }
  return enqueue(input);
}

Result<std::size_t> CudaBackend::reserve_step(const StepInput& input) {
  const auto reserve = [&](std::size_t instances) {
    return pipeline_.reserve(device_.primitives().n, static_cast<int>(input.camera.width),
                             static_cast<int>(input.camera.height), instances,
                             input.weight_normal > 0.0f, stream_);
  };
  const std::size_t target = instance_capacity();
  if (reserve(target).ok()) return target;
  STGS_TRY(stream_.wait());
  STGS_TRY(image_cache_.release_memory());
  // Without the slack, if memory does not suffice for it.
  const std::size_t minimum = std::max(recent_instances_, kMinInstances);
  const std::size_t instances = reserve(target).ok() ? target : std::min(target, minimum);
  STGS_TRY(reserve(instances));
  STGS_TRY(resize_image_cache());
  return instances;
}

Status CudaBackend::enqueue(const StepInput& input) {
  STGS_ASSIGN(const std::size_t instances, reserve_step(input));
  STGS_ASSIGN(const std::uint8_t* ground_truth, image_cache_.acquire(input.ground_truth, stream_));
  const std::size_t slot = next_slot_++ % kMaxInFlight;
  STGS_TRY(pipeline_.enqueue(device_, input, ground_truth, instances,
                             records_.on_device() + slot * ranks(), stream_));
  STGS_TRY(image_cache_.release(input.ground_truth, stream_));
  pending_.push_back({input, slot});
  return cuda_status(cudaEventRecord(done_[slot], stream_), "marking a step");
}

Status CudaBackend::collect(bool wait) {
  while (!pending_.empty()) {
    const std::size_t slot = pending_.front().slot;
    if (ranks_ != nullptr) {
      if (!wait && pending_.size() < kMaxSharedInFlight) return {};
      STGS_TRY(wait_shared(slot));
    }
    const cudaError_t state =
        wait ? cudaEventSynchronize(done_[slot]) : cudaEventQuery(done_[slot]);
    if (state == cudaErrorNotReady) {
      (void)cudaGetLastError();  // clears "not ready", which is not an error
      return {};
    }
    STGS_TRY(cuda_status(state, "working on a step"));
    const StepRecord& record = own_record(slot);
    if (record.overflow != 0) {
      STGS_TRY(retry(record.instances));
    } else {
      retire_oldest();
    }
  }
  return {};
}

const StepRecord& CudaBackend::own_record(std::size_t slot) const {
  return records_.data()[slot * ranks() + (ranks_ == nullptr ? 0 : ranks_->rank())];
}

void CudaBackend::retire_oldest() {
  const std::size_t slot = pending_.front().slot;
  const double decayed = kDecay * static_cast<double>(recent_instances_);
  recent_instances_ =
      std::max<std::size_t>(own_record(slot).instances, static_cast<std::size_t>(decayed));
  const bool with_camera = pending_.front().input.gather_camera;
  for (std::size_t r = 0; r < ranks(); ++r) {
    outputs_.push_back(output_of(records_.data()[slot * ranks() + r], with_camera));
  }
  pending_.pop_front();
}

std::size_t CudaBackend::abandon() {
  // If the device itself failed, no outputs are available.
  if (stream_.wait().ok()) {
    while (!pending_.empty() && own_record(pending_.front().slot).overflow == 0) retire_oldest();
  }
  const std::size_t incomplete = pending_.size() + std::exchange(dropped_steps_, 0);
  pending_.clear();
  (void)pipeline_.clear_overflow(stream_);  // a later call reports its error
  return incomplete;
}

Status CudaBackend::wait_shared(std::size_t slot) {
  for (;;) {
    const cudaError_t state = cudaEventQuery(done_[slot]);
    if (state != cudaErrorNotReady) return cuda_status(state, "working on a step");
    (void)cudaGetLastError();  // clears "not ready", which is not an error
    STGS_TRY(ranks_->check_peers());
    STGS_TRY(exchange_->check());
    std::this_thread::yield();
  }
}

Status CudaBackend::retry(std::size_t instances) {
  if (ranks_ != nullptr) STGS_TRY(wait_shared(pending_.back().slot));
  STGS_TRY(stream_.wait());
  STGS_TRY(check_instances(instances));
  recent_instances_ = std::max(recent_instances_, instances);
  STGS_TRY(pipeline_.clear_overflow(stream_));
  std::deque<PendingStep> steps;
  steps.swap(pending_);
  retried_steps_ += steps.size();
  for (; !steps.empty(); steps.pop_front()) {
    Status enqueued = enqueue(steps.front().input);
    if (!enqueued.ok()) {
      dropped_steps_ = steps.size();
      return enqueued;
    }
  }
  return {};
}

Result<std::vector<StepOutput>> CudaBackend::read() {
  STGS_TRY(collect(true));
  std::vector<StepOutput> outputs;
  outputs.swap(outputs_);
  return outputs;
}

Status CudaBackend::limit_scales(std::span<const math::PinholeCamera> cameras, float pixels) {
  STGS_TRY(collect(true));
  STGS_TRY(cameras_.ensure(cameras.size()));
  STGS_TRY(cuda_status(cudaMemcpyAsync(cameras_.data(), cameras.data(), cameras.size_bytes(),
                                       cudaMemcpyHostToDevice, stream_),
                       "copying the cameras"));
  launch_limit_scales(device_.primitives(), cameras_.data(),
                      static_cast<std::uint32_t>(cameras.size()), pixels, stream_);
  device_.round(stream_);
  return cuda_status(cudaGetLastError(), "limiting the scales");
}

Status CudaBackend::synchronise() {
  STGS_TRY(collect(true));
  return device_.download(*state_, stream_);
}

}  // namespace cuda

Result<std::unique_ptr<TrainBackend>> make_cuda_backend(int gpu) {
  auto backend = std::make_unique<cuda::CudaBackend>();
  STGS_TRY(backend->create(gpu));
  return std::unique_ptr<TrainBackend>(std::move(backend));
}

}  // namespace stgs::encoder
