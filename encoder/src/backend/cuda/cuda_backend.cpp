// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/cuda_backend.h"

#include <algorithm>
#include <thread>
#include <utility>

namespace stgs::encoder {
namespace cuda {
namespace {

// Tile instances a primitive, before any step has told.
constexpr std::size_t kInstancesAPrimitive = 6;
constexpr std::size_t kInstancesFloor = std::size_t{1} << 16;
// Room for them, times the largest number seen.
constexpr double kSlack = 1.25;
// Of the largest number, what is kept from one step to the next.
constexpr double kMemory = 0.999;
// Share of the free memory that pictures may take once everything else has its place.
constexpr double kPictureShare = 0.85;

// Tile instances to make room for, before any step has told.
std::size_t first_room(std::size_t primitives) {
  return std::clamp(kInstancesAPrimitive * primitives, kInstancesFloor, kMaxInstances);
}

StepOutput output_of(const StepRecord& record) {
  StepOutput output;
  output.loss = record.loss;
  output.l1 = record.l1;
  output.ssim = record.ssim;
  output.normal = record.normal;
  output.perceptual = record.perceptual;
  output.visible = record.visible;
  return output;
}

Status too_little_memory(const TrainPlan& plan, std::size_t need, std::size_t free,
                         std::size_t total, std::size_t perceptual) {
  const auto text = [](std::size_t bytes) { return bytes_text(static_cast<double>(bytes)); };
  return unsupported(
      "training {} primitives on {}x{} pictures needs {} of GPU memory, and {} of {} are free: "
      "use fewer primitives (--max-primitives) or smaller frames{}, or --backend cpu",
      plan.primitives, plan.width, plan.height, text(need), text(free), text(total),
      perceptual == 0
          ? ""
          : fmt::format(", or a smaller perceptual_patch ({} of it)", text(perceptual)));
}

// kRuntime where a view has more tile instances than can be listed.
Status check_instances(std::size_t instances) {
  if (instances <= kMaxInstances) return {};
  return runtime_error(
      "a view's primitives touch {} tiles, more than the {} that a step can list: the scene has "
      "grown out of bounds",
      instances, kMaxInstances);
}

Status device_problem(const char* text) {
  return unsupported("training with CUDA needs an NVIDIA GPU and its driver: {}", text);
}

}  // namespace

CudaBackend::~CudaBackend() {
  // Where another rank has failed, the GPU would wait for it for ever.
  if (exchange_ && cudaStreamQuery(stream_) == cudaErrorNotReady) exchange_->abort();
  (void)stream_.wait();
}

Status CudaBackend::create(int gpu) {
  int count = 0;
  if (const cudaError_t error = cudaGetDeviceCount(&count); error != cudaSuccess) {
    // The runtime says the same of a missing driver as of one that is too old.
    if (error == cudaErrorInsufficientDriver) return device_problem("no driver, or too old a one");
    return device_problem(cudaGetErrorString(error));
  }
  if (count == 0) return device_problem("no device found");
  cudaDeviceProp properties{};
  const int device = gpu % count;
  STGS_TRY(cuda_status(cudaSetDevice(device), "choosing the GPU"));
  STGS_TRY(cuda_status(cudaGetDeviceProperties(&properties, device), "asking about the GPU"));
  name_ = fmt::format("cuda ({})", properties.name);
  if (const cudaError_t error = kernels_loadable(); error != cudaSuccess) {
    (void)cudaGetLastError();
    return unsupported(
        "this build has no code for the {} (compute capability {}.{}): build again with "
        "-DCMAKE_CUDA_ARCHITECTURES={}{}",
        properties.name, properties.major, properties.minor, properties.major, properties.minor);
  }
  STGS_TRY(stream_.create());
  STGS_TRY(pipeline_.create(stream_));
  STGS_TRY(densifier_.create());
  STGS_TRY(records_.ensure(kInFlight));
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
  return records_.ensure(kInFlight * this->ranks());
}

Status CudaBackend::reserve(const TrainPlan& plan) {
  STGS_TRY(truths_.give_back());
  const std::size_t pixels = std::size_t{1} * plan.width * plan.height;
  const std::size_t instances = first_room(plan.primitives);
  const std::size_t state_bytes =
      DeviceState::bytes(plan.primitives, plan.sh_coefficients, plan.coupled);
  const std::size_t step_bytes =
      StepPipeline::bytes(plan.primitives, plan.width, plan.height, instances, plan.normals);
  const std::size_t shared_bytes = ranks_ == nullptr ? 0 : ranks() * block_bytes(plan.primitives);
  const std::size_t few_pictures = 16 * pixels;
  pipeline_.set_perceptual(nullptr);
  std::unique_ptr<PerceptualNetwork> perceptual;
  std::size_t perceptual_bytes = 0;
  const Patch patch = patch_size(plan.width, plan.height, plan.perceptual_patch);
  if (plan.perceptual) {
    STGS_ASSIGN(perceptual, make_perceptual_network(plan.perceptual));
    STGS_ASSIGN(perceptual_bytes, perceptual->bytes(patch.width, patch.height));
  }
  std::size_t free = 0, total = 0;
  STGS_TRY(cuda_status(cudaMemGetInfo(&free, &total), "asking for the GPU's memory"));
  const std::size_t need =
      state_bytes + step_bytes + shared_bytes + few_pictures + perceptual_bytes;
  if (need > free) return too_little_memory(plan, need, free, total, perceptual_bytes);
  if (perceptual) STGS_TRY(perceptual->reserve(patch.width, patch.height));
  pipeline_.set_perceptual(std::move(perceptual));
  if (ranks_ != nullptr) {
    STGS_TRY(pipeline_.set_ranks(*ranks_, exchange_.get(), plan.primitives));
  }
  STGS_TRY(device_.reserve(plan.primitives, plan.sh_coefficients, plan.coupled));
  // What only just fits may still fail: the driver rounds each array up.
  if (!pipeline_.reserve(plan.primitives, plan.width, plan.height, instances, plan.normals, stream_)
           .ok()) {
    return too_little_memory(plan, need, free, total, perceptual_bytes);
  }
  return share_with_pictures();
}

Status CudaBackend::share_with_pictures() {
  std::size_t free = 0, total = 0;
  STGS_TRY(cuda_status(cudaMemGetInfo(&free, &total), "asking for the GPU's memory"));
  return truths_.create(static_cast<std::size_t>(kPictureShare * static_cast<double>(free)));
}

Status CudaBackend::begin(TrainState& state) {
  STGS_TRY(collect(true));
  state_ = &state;
  return device_.upload(state, stream_);
}

Result<DensifyCounts> CudaBackend::densify(const DensifyInput& input) {
  STGS_TRY(collect(true));
  const std::size_t before = size();
  // Room to append in, where reserve() has not been told of it.
  const std::size_t most =
      std::max(before, static_cast<std::size_t>(std::max(input.parameters->max_primitives, 0)));
  if (device_.capacity() < most) {
    STGS_TRY(synchronise());
    STGS_TRY(device_.reserve(most, device_.primitives().sh_coefficients, state_->is_coupled()));
    STGS_TRY(device_.upload(*state_, stream_));
  }
  STGS_TRY(pipeline_.reserve(most, 1, 1, first_room(most), false, stream_));
  const Workspace& w = pipeline_.workspace();
  STGS_ASSIGN(const DensifyCounts counts,
              input.refining ? densifier_.replace(device_, *input.parameters, input.context,
                                                  state_->iteration, w, stream_)
                             : densifier_.grow(device_, *input.parameters, input.context,
                                               state_->iteration, w, stream_));
  if (input.reset_opacity) {
    const DensifyRules rules = densify_rules(*input.parameters, input.context);
    launch_reset_opacity(device_.primitives(), reset_logit(rules), stream_);
    STGS_TRY(cuda_status(cudaGetLastError(), "resetting the opacities"));
  }
  if (state_->is_coupled()) launch_derive_coupled(device_.primitives(), stream_);
  // The number of instances grows with that of the primitives.
  if (before > 0 && size() > before) instances_seen_ = instances_seen_ * size() / before;
  return counts;
}

std::size_t CudaBackend::room() const {
  if (instances_seen_ == 0) return first_room(device_.primitives().n);
  const auto wanted = static_cast<std::size_t>(kSlack * static_cast<double>(instances_seen_));
  return std::clamp(wanted, kInstancesFloor, kMaxInstances);
}

Status CudaBackend::step(const StepInput& input) {
  STGS_TRY(collect(false));
  // Again and again: where a step did not fit, all are under way once more.
  while (pending_.size() >= kInFlight) {
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
  const std::size_t wanted = room();
  if (reserve(wanted).ok()) return wanted;
  STGS_TRY(stream_.wait());
  STGS_TRY(truths_.give_back());
  // Without the slack for the next steps, where there is no room for that.
  const std::size_t least = std::max(instances_seen_, kInstancesFloor);
  const std::size_t instances = reserve(wanted).ok() ? wanted : std::min(wanted, least);
  STGS_TRY(reserve(instances));
  STGS_TRY(share_with_pictures());
  return instances;
}

Status CudaBackend::enqueue(const StepInput& input) {
  STGS_ASSIGN(const std::size_t instances, reserve_step(input));
  STGS_ASSIGN(const std::uint8_t* truth, truths_.acquire(input.ground_truth, stream_));
  const std::size_t slot = next_slot_++ % kInFlight;
  STGS_TRY(pipeline_.enqueue(device_, input, truth, instances,
                             records_.on_device() + slot * ranks(), stream_));
  STGS_TRY(truths_.release(input.ground_truth, stream_));
  pending_.push_back({input, slot});
  return cuda_status(cudaEventRecord(done_[slot], stream_), "marking a step");
}

Status CudaBackend::collect(bool wait) {
  while (!pending_.empty()) {
    const std::size_t slot = pending_.front().slot;
    if (ranks_ != nullptr) {
      if (!wait && pending_.size() < kSharedInFlight) return {};
      STGS_TRY(wait_shared(slot));
    }
    const cudaError_t state =
        wait ? cudaEventSynchronize(done_[slot]) : cudaEventQuery(done_[slot]);
    if (state == cudaErrorNotReady) {
      (void)cudaGetLastError();  // not an error, but remembered as one
      return {};
    }
    STGS_TRY(cuda_status(state, "working on a step"));
    const StepRecord& record = own_record(slot);
    if (record.overflow != 0) {
      STGS_TRY(redo(record.instances));
    } else {
      take_oldest();
    }
  }
  return {};
}

const StepRecord& CudaBackend::own_record(std::size_t slot) const {
  return records_.data()[slot * ranks() + (ranks_ == nullptr ? 0 : ranks_->rank())];
}

void CudaBackend::take_oldest() {
  const std::size_t slot = pending_.front().slot;
  const double kept = kMemory * static_cast<double>(instances_seen_);
  instances_seen_ =
      std::max<std::size_t>(own_record(slot).instances, static_cast<std::size_t>(kept));
  for (std::size_t r = 0; r < ranks(); ++r) {
    outputs_.push_back(output_of(records_.data()[slot * ranks() + r]));
  }
  pending_.pop_front();
}

std::size_t CudaBackend::abandon() {
  // Where the device itself has failed there is nothing to be had from it.
  if (stream_.wait().ok()) {
    while (!pending_.empty() && own_record(pending_.front().slot).overflow == 0) take_oldest();
  }
  const std::size_t undone = pending_.size() + std::exchange(lost_, 0);
  pending_.clear();
  (void)pipeline_.clear_overflow(stream_);  // its error comes again with whatever follows
  return undone;
}

Status CudaBackend::wait_shared(std::size_t slot) {
  for (;;) {
    const cudaError_t state = cudaEventQuery(done_[slot]);
    if (state != cudaErrorNotReady) return cuda_status(state, "working on a step");
    (void)cudaGetLastError();  // not an error, but remembered as one
    STGS_TRY(ranks_->check_peers());
    STGS_TRY(exchange_->check());
    std::this_thread::yield();
  }
}

// The oldest pending step did not fit: makes room and does all pending ones again.
Status CudaBackend::redo(std::size_t instances) {
  if (ranks_ != nullptr) STGS_TRY(wait_shared(pending_.back().slot));
  STGS_TRY(stream_.wait());
  STGS_TRY(check_instances(instances));
  instances_seen_ = std::max(instances_seen_, instances);
  STGS_TRY(pipeline_.clear_overflow(stream_));
  std::deque<Pending> again;
  again.swap(pending_);
  redone_ += again.size();
  for (; !again.empty(); again.pop_front()) {
    const Status enqueued = enqueue(again.front().input);
    if (!enqueued.ok()) {
      lost_ = again.size();
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

Status CudaBackend::synchronise() {
  STGS_TRY(collect(true));
  return device_.download(*state_, stream_);
}

Status CudaBackend::weigh(const ImportanceView& view, unsigned long long* sums) {
  StepInput input;
  input.camera = view.camera;
  input.ticks = view.ticks;
  for (;;) {
    STGS_ASSIGN(const std::size_t room, reserve_step(input));
    STGS_ASSIGN(const Counters seen, pipeline_.weigh(device_, input, room, sums, stream_));
    STGS_TRY(check_instances(seen.instances));
    instances_seen_ = std::max<std::size_t>(instances_seen_, seen.instances);
    if (seen.overflow == 0) return {};
  }
}

Result<std::optional<std::vector<float>>> CudaBackend::importance(
    std::span<const ImportanceView> views, const std::function<bool(double)>& go_on) {
  using Importance = std::optional<std::vector<float>>;
  STGS_TRY(collect(true));
  const std::size_t n = size();
  DeviceArray<unsigned long long> sums;
  if (!sums.ensure(n).ok()) {
    STGS_TRY(truths_.give_back());
    STGS_TRY(sums.ensure(n));
  }
  STGS_TRY(cuda_status(cudaMemsetAsync(sums.data(), 0, n * sizeof(unsigned long long), stream_),
                       "clearing the importances"));
  for (std::size_t v = 0; v < views.size(); ++v) {
    if (!go_on(static_cast<double>(v) / static_cast<double>(views.size()))) return Importance();
    STGS_TRY(weigh(views[v], sums.data()));
  }
  std::vector<unsigned long long> found(n);
  STGS_TRY(cuda_status(cudaMemcpyAsync(found.data(), sums.data(), n * sizeof(found[0]),
                                       cudaMemcpyDeviceToHost, stream_),
                       "copying the importances"));
  STGS_TRY(stream_.wait());
  Importance out(n);
  std::transform(found.begin(), found.end(), out->begin(), [](unsigned long long sum) {
    return static_cast<float>(static_cast<double>(sum) / kImportanceOne);
  });
  return out;
}

}  // namespace cuda

Result<std::unique_ptr<TrainBackend>> make_cuda_backend(int gpu) {
  auto backend = std::make_unique<cuda::CudaBackend>();
  STGS_TRY(backend->create(gpu));
  return std::unique_ptr<TrainBackend>(std::move(backend));
}

}  // namespace stgs::encoder
