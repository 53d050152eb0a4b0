// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/perceptual_network.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "backend/cuda/cudnn_convolution.h"
#include "backend/cuda/cudnn_library.h"
#include "backend/cuda/memory.h"
#include "backend/cuda/perceptual_kernels.h"
#include "perceptual/convolution_backward.h"

namespace stgs::encoder::cuda {
namespace {

// Owns an executable CUDA graph.
class Graph {
 public:
  Graph() = default;
  Graph(Graph&& other) noexcept : graph_(std::exchange(other.graph_, nullptr)) {}
  Graph& operator=(Graph&& other) noexcept {
    std::swap(graph_, other.graph_);
    return *this;
  }
  ~Graph() {
    if (graph_ != nullptr) cudaGraphExecDestroy(graph_);
  }
  cudaError_t create(cudaGraph_t recorded) { return cudaGraphInstantiate(&graph_, recorded, 0); }
  operator cudaGraphExec_t() const { return graph_; }  // NOLINT: implicit by design

 private:
  cudaGraphExec_t graph_ = nullptr;
};

// The recorded pass for patches of one size.
struct RecordedPass {
  int width = 0, height = 0;
  Graph graph;
};

// A stage of the network on the device. `forward` and `backward` are unused for a pooling,
// `backward` for a convolution with a stride.
struct Stage {
  CudnnConvolution forward, backward;
  FeatureSize size{};                  // of its output
  DeviceArray<float> features;         // of both images; after ReLU if it is a convolution
  DeviceArray<float> channel_weights;  // if it is a tap
};

class CudnnPerceptual final : public PerceptualNetwork {
 public:
  explicit CudnnPerceptual(std::shared_ptr<const FeatureNetwork> network)
      : network_(std::move(network)), stages_(network_->stages.size()) {}

  Status create(ConvolutionPrecision precision);
  Result<std::size_t> bytes(int width, int height) override;
  Status reserve(int width, int height) override;
  Status enqueue(const PerceptualStep& step, cudaStream_t stream) override;
  const double* value() const override { return value_.data(); }

 private:
  // Sets the sizes of all stages for patches of this size.
  Status set_size(int width, int height);
  Status describe_sizes();
  const FeatureSize& input_size(std::size_t stage) const {
    return stage == 0 ? size_ : stages_[stage - 1].size;
  }
  Result<std::size_t> workspace_bytes() const;
  std::size_t gradient_values() const;
  Status upload_network();
  Status pass(int width, int height, cudaStream_t stream);
  Status record(cudaStream_t stream);
  Status run(cudaStream_t stream);
  Status forward(cudaStream_t stream);
  Status backward(cudaStream_t stream);
  Status convolve_backward(std::size_t stage, const float* gradient, float* next,
                           cudaStream_t stream);
  CudnnWorkspace workspace() { return {workspace_.data(), workspace_.capacity()}; }

  std::shared_ptr<const FeatureNetwork> network_;
  Cudnn cudnn_{};
  CudnnObject<cudnnHandle_t> handle_;
  CudnnObject<cudnnActivationDescriptor_t> relu_;
  std::vector<Stage> stages_;
  FeatureSize size_{};  // of the input, for which the stages are set
  int taps_ = 0;

  DeviceArray<float> input_, gradient_, next_gradient_;
  DeviceArray<float> strided_weights_;  // of the first stage, if it has a stride
  DeviceArray<float> sums_, map_parts_;
  DeviceArray<double> value_;
  DeviceArray<std::uint8_t> workspace_;
  const float* input_gradient_ = nullptr;  // dL/d(input_) after a pass of any size
  std::vector<RecordedPass> recorded_;
};

Status CudnnPerceptual::create(ConvolutionPrecision precision) {
  STGS_ASSIGN(cudnn_, Cudnn::load());
  STGS_TRY(cudnn_.status(handle_.create(cudnn_.create, cudnn_.destroy), "starting"));
  STGS_TRY(cudnn_.status(relu_.create(cudnn_.create_activation, cudnn_.destroy_activation),
                         "describing a ReLU"));
  STGS_TRY(
      cudnn_.status(cudnn_.set_activation(relu_, CUDNN_ACTIVATION_RELU, CUDNN_PROPAGATE_NAN, 0.0),
                    "describing a ReLU"));
  const cudnnMathType_t math =
      precision == ConvolutionPrecision::kFloat ? CUDNN_FMA_MATH : CUDNN_DEFAULT_MATH;
  for (std::size_t i = 0; i < stages_.size(); ++i) {
    const FeatureStage& stage = network_->stages[i];
    taps_ += stage.is_tap();
    if (stage.is_pooling()) continue;
    const int in = i == 0 ? kNetworkInputs : stage.in;
    STGS_TRY(stages_[i].forward.create_forward(cudnn_, stage, in, math));
    if (stage.window.stride > 1) continue;
    STGS_TRY(stages_[i].backward.create_backward(cudnn_, stage, in, math));
  }
  return {};
}

Status CudnnPerceptual::set_size(int width, int height) {
  if (width == size_.width && height == size_.height) return {};
  size_ = {width, height, kNetworkInputs};
  std::size_t largest = size_.values();
  for (std::size_t i = 0; i < stages_.size(); ++i) {
    const FeatureStage& stage = network_->stages[i];
    const FeatureSize& in = input_size(i);
    stages_[i].size = {stage.window.count(in.width), stage.window.count(in.height), stage.out};
    largest = std::max(largest, stages_[i].size.values());
  }
  if (2 * largest > INT32_MAX) {  // of both images; cuDNN uses 32-bit sizes
    size_ = {};
    return unsupported(
        "patches of {}x{} pixels are too large for cuDNN; use a smaller perceptual_patch", width,
        height);
  }
  const Status described = describe_sizes();
  if (!described.ok()) size_ = {};
  return described;
}

Status CudnnPerceptual::describe_sizes() {
  for (std::size_t i = 0; i < stages_.size(); ++i) {
    const FeatureStage& stage = network_->stages[i];
    if (stage.is_pooling()) continue;
    STGS_TRY(stages_[i].forward.set_size(2, input_size(i), stages_[i].size));
    if (stage.window.stride > 1) continue;
    STGS_TRY(stages_[i].backward.set_size(1, stages_[i].size, input_size(i)));
  }
  return {};
}

Result<std::size_t> CudnnPerceptual::workspace_bytes() const {
  std::size_t maximum = 0;
  for (std::size_t i = 0; i < stages_.size(); ++i) {
    const FeatureStage& stage = network_->stages[i];
    if (stage.is_pooling()) continue;
    STGS_ASSIGN(const std::size_t forward, stages_[i].forward.workspace_bytes(handle_));
    maximum = std::max(maximum, forward);
    if (stage.window.stride > 1) continue;
    STGS_ASSIGN(const std::size_t backward, stages_[i].backward.workspace_bytes(handle_));
    maximum = std::max(maximum, backward);
  }
  return maximum;
}

std::size_t CudnnPerceptual::gradient_values() const {
  std::size_t maximum = size_.values();
  for (const Stage& stage : stages_) maximum = std::max(maximum, stage.size.values());
  return maximum;
}

Result<std::size_t> CudnnPerceptual::bytes(int width, int height) {
  STGS_TRY(set_size(width, height));
  STGS_ASSIGN(const std::size_t workspace, workspace_bytes());
  std::size_t values = 2 * size_.values() + 2 * gradient_values(), weights = 0;
  for (const Stage& stage : stages_) {
    values += 2 * stage.size.values();
    weights += stage.forward.weight_bytes() + stage.backward.weight_bytes();
  }
  values += static_cast<std::size_t>(taps_ + kMapGradients) * kPerceptualBlocks;
  return workspace + values * sizeof(float) + weights;
}

Status CudnnPerceptual::reserve(int width, int height) {
  recorded_.clear();
  STGS_TRY(set_size(width, height));
  STGS_ASSIGN(const std::size_t workspace, workspace_bytes());
  // The algorithm needs no workspace for some shapes.
  STGS_TRY(workspace_.ensure(std::max<std::size_t>(workspace, 1)));
  STGS_TRY(input_.ensure(2 * size_.values()));
  STGS_TRY(gradient_.ensure(gradient_values()));
  STGS_TRY(next_gradient_.ensure(gradient_values()));
  for (Stage& stage : stages_) STGS_TRY(stage.features.ensure(2 * stage.size.values()));
  STGS_TRY(sums_.ensure(std::size_t{1} * taps_ * kPerceptualBlocks));
  STGS_TRY(map_parts_.ensure(kMapGradients * kPerceptualBlocks));
  STGS_TRY(value_.ensure(1));
  return upload_network();
}

Status CudnnPerceptual::upload_network() {
  for (std::size_t i = 0; i < stages_.size(); ++i) {
    const FeatureStage& stage = network_->stages[i];
    if (stage.is_tap()) STGS_TRY(upload_weights(stage.channel_weights, stages_[i].channel_weights));
    if (stage.is_pooling()) continue;
    STGS_TRY(stages_[i].forward.upload());
    if (stage.window.stride > 1) {
      const int taps = stage.window.size * stage.window.size;
      STGS_TRY(upload_weights(weights_by_tap(stage.weight, stage.in, stage.out, taps),
                              strided_weights_));
    } else {
      STGS_TRY(stages_[i].backward.upload());
    }
  }
  return {};
}

Status CudnnPerceptual::enqueue(const PerceptualStep& step, cudaStream_t stream) {
  launch_network_input(step, input_.data(), stream);
  STGS_TRY(pass(step.patch.width, step.patch.height, stream));
  launch_input_gradient(step, input_gradient_, map_parts_.data(), stream);
  launch_totals(step, sums_.data(), taps_, map_parts_.data(), value_.data(), stream);
  return cuda_status(cudaGetLastError(), "starting the perceptual loss");
}

// Computes sums_ and the gradient from input_. The work and memory are identical for all patches of
// a size, so the pass is recorded once as a graph and then replayed.
Status CudnnPerceptual::pass(int width, int height, cudaStream_t stream) {
  for (const RecordedPass& recorded : recorded_) {
    if (recorded.width != width || recorded.height != height) continue;
    return cuda_status(cudaGraphLaunch(recorded.graph, stream), "starting the perceptual loss");
  }
  STGS_TRY(set_size(width, height));
  // A smaller patch may need more workspace. If it grows, CUDA waits for the work in flight.
  STGS_ASSIGN(const std::size_t workspace, workspace_bytes());
  if (workspace > workspace_.capacity()) {
    recorded_.clear();
    STGS_TRY(workspace_.ensure(workspace));
  }
  STGS_TRY(cudnn_.status(cudnn_.set_stream(handle_, stream), "choosing the stream"));
  STGS_TRY(run(stream));
  return record(stream);
}

Status CudnnPerceptual::record(cudaStream_t stream) {
  const char* operation = "recording the perceptual loss";
  cudaGraph_t graph = nullptr;
  STGS_TRY(
      cuda_status(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal), operation));
  const Status run_status = run(stream);
  const cudaError_t capture_error = cudaStreamEndCapture(stream, &graph);
  RecordedPass recorded{size_.width, size_.height, {}};
  Status status = run_status.ok() ? cuda_status(capture_error, operation) : run_status;
  if (status.ok()) status = cuda_status(recorded.graph.create(graph), operation);
  if (graph != nullptr) cudaGraphDestroy(graph);
  STGS_TRY(status);
  recorded_.push_back(std::move(recorded));
  return {};
}

Status CudnnPerceptual::run(cudaStream_t stream) {
  STGS_TRY(forward(stream));
  return backward(stream);
}

Status CudnnPerceptual::forward(cudaStream_t stream) {
  const float* in = input_.data();
  for (std::size_t i = 0; i < stages_.size(); ++i) {
    Stage& stage = stages_[i];
    if (network_->stages[i].is_pooling()) {
      launch_pool(in, input_size(i), network_->stages[i].window, stage.size, stage.features.data(),
                  stream);
    } else {
      STGS_TRY(stage.forward.apply(handle_, relu_, in, workspace(), stage.features.data()));
    }
    in = stage.features.data();
  }
  return {};
}

Status CudnnPerceptual::backward(cudaStream_t stream) {
  float *gradient = gradient_.data(), *next = next_gradient_.data();
  int tap = taps_;
  for (std::size_t i = stages_.size(); i-- > 0;) {
    // `gradient` is that of this stage's output. The kernel of a tap computes the backward pass of
    // a pooling after it too.
    if (network_->stages[i].is_pooling()) continue;
    Stage& stage = stages_[i];
    if (network_->stages[i].is_tap()) {
      TapBackward step;
      step.size = stage.size;
      step.features = stage.features.data();
      step.weights = stage.channel_weights.data();
      step.d_output = i + 1 < stages_.size() ? gradient : nullptr;
      if (i + 1 < stages_.size() && network_->stages[i + 1].is_pooling()) {
        step.window = network_->stages[i + 1].window;
        step.pooled_size = stages_[i + 1].size;
        step.pooled = stages_[i + 1].features.data();
      }
      step.gradient = next;
      step.sums = sums_.data() + std::size_t{1} * --tap * kPerceptualBlocks;
      launch_tap_backward(step, stream);
      std::swap(gradient, next);
    } else {
      launch_relu_backward(stage.features.data(), stage.size, gradient, stream);
    }
    STGS_TRY(convolve_backward(i, gradient, next, stream));
    std::swap(gradient, next);
  }
  input_gradient_ = gradient;
  return {};
}

Status CudnnPerceptual::convolve_backward(std::size_t stage, const float* gradient, float* next,
                                          cudaStream_t stream) {
  const Window& window = network_->stages[stage].window;
  if (window.stride == 1)
    return stages_[stage].backward.apply(handle_, nullptr, gradient, workspace(), next);
  launch_strided_backward({stages_[stage].size, size_, window, strided_weights_.data()}, gradient,
                          next, stream);
  return {};
}

}  // namespace

Status check_perceptual_network() {
  return Cudnn::load().status();
}

Result<std::unique_ptr<PerceptualNetwork>> make_perceptual_network(
    std::shared_ptr<const FeatureNetwork> network, ConvolutionPrecision precision) {
  auto made = std::make_unique<CudnnPerceptual>(std::move(network));
  STGS_TRY(made->create(precision));
  return std::unique_ptr<PerceptualNetwork>(std::move(made));
}

}  // namespace stgs::encoder::cuda
