// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/perceptual_network.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "backend/cuda/cudnn_library.h"
#include "backend/cuda/memory.h"
#include "backend/cuda/perceptual_kernels.h"

namespace stgs::encoder::cuda {
namespace {

constexpr std::size_t kLayers = kVggLayers.size();
// Deterministic, available for all shapes, and supports the tensor cores.
constexpr cudnnConvolutionFwdAlgo_t kAlgorithm = CUDNN_CONVOLUTION_FWD_ALGO_IMPLICIT_PRECOMP_GEMM;

int input_channels(std::size_t layer) {
  return layer == 0 ? kVggInputs : kVggLayers[layer].in;
}

// The cuDNN arguments of a convolution.
struct Convolution {
  CudnnObject<cudnnTensorDescriptor_t> input, output, bias_shape;
  CudnnObject<cudnnFilterDescriptor_t> filter;
  DeviceArray<float> weights, bias;  // weights: out x 3 x 3 x in
  int in = 0, out = 0;

  std::size_t weight_count() const { return std::size_t{9} * in * out; }
};

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

// Converts weights from out x in x 3 x 3 to out x 3 x 3 x in_stored, zero-padding the inputs.
std::vector<float> forward_weights(const VggConvolution& convolution, const VggLayer& layer,
                                   int in_stored) {
  std::vector<float> weights(std::size_t{9} * in_stored * layer.out);
  for (int o = 0; o < layer.out; ++o) {
    for (int c = 0; c < layer.in; ++c) {
      for (int tap = 0; tap < 9; ++tap)
        weights[(std::size_t{9} * o + tap) * in_stored + c] =
            convolution.weight[(std::size_t{1} * o * layer.in + c) * 9 + tap];
    }
  }
  return weights;
}

// Returns the weights that map dL/doutput to dL/dinput: flipped, in_stored x 3 x 3 x out.
std::vector<float> backward_weights(const VggConvolution& convolution, const VggLayer& layer,
                                    int in_stored) {
  std::vector<float> weights(std::size_t{9} * in_stored * layer.out);
  for (int o = 0; o < layer.out; ++o) {
    for (int c = 0; c < layer.in; ++c) {
      for (int tap = 0; tap < 9; ++tap)
        weights[(std::size_t{9} * c + 8 - tap) * layer.out + o] =
            convolution.weight[(std::size_t{1} * o * layer.in + c) * 9 + tap];
    }
  }
  return weights;
}

Status upload(const std::vector<float>& values, DeviceArray<float>& array) {
  STGS_TRY(array.ensure(values.size()));
  return cuda_status(cudaMemcpy(array.data(), values.data(), values.size() * sizeof(float),
                                cudaMemcpyHostToDevice),
                     "uploading the weights of the perceptual loss");
}

class CudnnPerceptual final : public PerceptualNetwork {
 public:
  explicit CudnnPerceptual(std::shared_ptr<const Vgg16> network) : network_(std::move(network)) {}

  Status create(VggPrecision precision);
  Result<std::size_t> bytes(int width, int height) override;
  Status reserve(int width, int height) override;
  Status enqueue(const PerceptualStep& step, cudaStream_t stream) override;
  const double* value() const override { return value_.data(); }

 private:
  Status create_convolution(int in, int out, Convolution& convolution);
  // Sets the descriptors and sizes_ for patches of this size.
  Status set_size(int width, int height);
  Status set_shapes(Convolution& convolution, int images, const FeatureSize& size);
  Result<std::size_t> workspace_bytes();
  std::size_t gradient_values() const;
  Status upload_weights();
  Status pass(int width, int height, cudaStream_t stream);
  Status record(cudaStream_t stream);
  Status run(cudaStream_t stream);
  Status forward(cudaStream_t stream);
  Status backward(cudaStream_t stream);
  Status convolve_forward(std::size_t layer, const float* input);

  std::shared_ptr<const Vgg16> network_;
  Cudnn cudnn_{};
  CudnnObject<cudnnHandle_t> handle_;
  CudnnObject<cudnnConvolutionDescriptor_t> convolution_;
  CudnnObject<cudnnActivationDescriptor_t> relu_;
  std::array<Convolution, kLayers> forward_, backward_;
  std::array<FeatureSize, kLayers> sizes_{};  // of the output of each layer
  int width_ = 0, height_ = 0;                // of the patches they are set for

  DeviceArray<float> input_, gradient_, next_gradient_;
  std::array<DeviceArray<float>, kLayers> features_;  // after ReLU, of both images
  std::array<DeviceArray<float>, kLayers> pooled_;    // input of layers that follow a pooling
  std::array<DeviceArray<float>, kVggTaps> channel_weights_;
  DeviceArray<float> sums_, map_parts_;
  DeviceArray<double> value_;
  DeviceArray<std::uint8_t> workspace_;
  const float* input_gradient_ = nullptr;  // dL/d(input_) after a pass of any size
  std::vector<RecordedPass> recorded_;
};

Status CudnnPerceptual::create(VggPrecision precision) {
  STGS_ASSIGN(cudnn_, Cudnn::load());
  STGS_TRY(cudnn_.status(handle_.create(cudnn_.create, cudnn_.destroy), "starting"));
  STGS_TRY(cudnn_.status(convolution_.create(cudnn_.create_convolution, cudnn_.destroy_convolution),
                         "describing a convolution"));
  STGS_TRY(cudnn_.status(cudnn_.set_convolution(convolution_, 1, 1, 1, 1, 1, 1,
                                                CUDNN_CROSS_CORRELATION, CUDNN_DATA_FLOAT),
                         "describing a convolution"));
  const cudnnMathType_t math =
      precision == VggPrecision::kFloat ? CUDNN_FMA_MATH : CUDNN_DEFAULT_MATH;
  STGS_TRY(cudnn_.status(cudnn_.set_math_type(convolution_, math), "choosing the precision"));
  STGS_TRY(cudnn_.status(relu_.create(cudnn_.create_activation, cudnn_.destroy_activation),
                         "describing a ReLU"));
  STGS_TRY(
      cudnn_.status(cudnn_.set_activation(relu_, CUDNN_ACTIVATION_RELU, CUDNN_PROPAGATE_NAN, 0.0),
                    "describing a ReLU"));
  for (std::size_t i = 0; i < kLayers; ++i) {
    const int in = input_channels(i), out = kVggLayers[i].out;
    STGS_TRY(create_convolution(in, out, forward_[i]));
    STGS_TRY(create_convolution(out, in, backward_[i]));
  }
  return {};
}

Status CudnnPerceptual::create_convolution(int in, int out, Convolution& convolution) {
  const char* operation = "describing a layer";
  convolution.in = in;
  convolution.out = out;
  for (auto* tensor : {&convolution.input, &convolution.output, &convolution.bias_shape})
    STGS_TRY(cudnn_.status(tensor->create(cudnn_.create_tensor, cudnn_.destroy_tensor), operation));
  STGS_TRY(cudnn_.status(convolution.filter.create(cudnn_.create_filter, cudnn_.destroy_filter),
                         operation));
  STGS_TRY(cudnn_.status(
      cudnn_.set_filter(convolution.filter, CUDNN_DATA_FLOAT, CUDNN_TENSOR_NHWC, out, in, 3, 3),
      operation));
  return cudnn_.status(
      cudnn_.set_tensor(convolution.bias_shape, CUDNN_TENSOR_NHWC, CUDNN_DATA_FLOAT, 1, out, 1, 1),
      operation);
}

Status CudnnPerceptual::set_shapes(Convolution& convolution, int images, const FeatureSize& size) {
  const char* operation = "describing a layer's size";
  STGS_TRY(cudnn_.status(cudnn_.set_tensor(convolution.input, CUDNN_TENSOR_NHWC, CUDNN_DATA_FLOAT,
                                           images, convolution.in, size.height, size.width),
                         operation));
  return cudnn_.status(cudnn_.set_tensor(convolution.output, CUDNN_TENSOR_NHWC, CUDNN_DATA_FLOAT,
                                         images, convolution.out, size.height, size.width),
                       operation);
}

Status CudnnPerceptual::set_size(int width, int height) {
  if (width == width_ && height == height_) return {};
  // The size of the largest features, of both images; cuDNN uses 32-bit sizes.
  if (std::int64_t{2} * width * height * kVggLayers[0].out > INT32_MAX) {
    return unsupported(
        "patches of {}x{} pixels are too large for cuDNN; use a smaller perceptual_patch", width,
        height);
  }
  width_ = width;
  height_ = height;
  for (std::size_t i = 0; i < kLayers; ++i) {
    if (kVggLayers[i].pool_before) {
      width /= 2;
      height /= 2;
    }
    sizes_[i] = {width, height, kVggLayers[i].out};
    STGS_TRY(set_shapes(forward_[i], 2, sizes_[i]));
    STGS_TRY(set_shapes(backward_[i], 1, sizes_[i]));
  }
  return {};
}

Result<std::size_t> CudnnPerceptual::workspace_bytes() {
  std::size_t maximum = 0;
  for (const auto* convolutions : {&forward_, &backward_}) {
    for (const Convolution& c : *convolutions) {
      std::size_t bytes = 0;
      STGS_TRY(cudnn_.status(cudnn_.workspace_size(handle_, c.input, c.filter, convolution_,
                                                   c.output, kAlgorithm, &bytes),
                             "querying the workspace size"));
      maximum = std::max(maximum, bytes);
    }
  }
  return maximum;
}

std::size_t CudnnPerceptual::gradient_values() const {
  std::size_t maximum = 0;
  for (const FeatureSize& size : sizes_) maximum = std::max(maximum, size.values());
  return maximum;
}

Result<std::size_t> CudnnPerceptual::bytes(int width, int height) {
  STGS_TRY(set_size(width, height));
  STGS_ASSIGN(const std::size_t workspace, workspace_bytes());
  std::size_t values = 2 * kVggInputs * std::size_t{1} * width * height + 2 * gradient_values();
  for (std::size_t i = 0; i < kLayers; ++i) {
    values += 2 * sizes_[i].values() + forward_[i].weight_count() + backward_[i].weight_count();
    if (kVggLayers[i].pool_before) values += 2 * sizes_[i].pixels() * forward_[i].in;
  }
  return workspace + values * sizeof(float);
}

Status CudnnPerceptual::reserve(int width, int height) {
  recorded_.clear();
  STGS_TRY(set_size(width, height));
  STGS_ASSIGN(const std::size_t workspace, workspace_bytes());
  // The algorithm needs no workspace for some shapes.
  STGS_TRY(workspace_.ensure(std::max<std::size_t>(workspace, 1)));
  STGS_TRY(input_.ensure(2 * kVggInputs * std::size_t{1} * width * height));
  STGS_TRY(gradient_.ensure(gradient_values()));
  STGS_TRY(next_gradient_.ensure(gradient_values()));
  for (std::size_t i = 0; i < kLayers; ++i) {
    STGS_TRY(features_[i].ensure(2 * sizes_[i].values()));
    if (kVggLayers[i].pool_before)
      STGS_TRY(pooled_[i].ensure(2 * sizes_[i].pixels() * forward_[i].in));
  }
  STGS_TRY(sums_.ensure(kVggTaps * kVggBlocks));
  STGS_TRY(map_parts_.ensure(kMapGradients * kVggBlocks));
  STGS_TRY(value_.ensure(1));
  return upload_weights();
}

Status CudnnPerceptual::upload_weights() {
  for (std::size_t i = 0; i < kLayers; ++i) {
    const VggConvolution& convolution = network_->convolutions[i];
    const int in = input_channels(i);
    STGS_TRY(upload(forward_weights(convolution, kVggLayers[i], in), forward_[i].weights));
    STGS_TRY(upload(convolution.bias, forward_[i].bias));
    STGS_TRY(upload(backward_weights(convolution, kVggLayers[i], in), backward_[i].weights));
  }
  for (int tap = 0; tap < kVggTaps; ++tap)
    STGS_TRY(upload(network_->channel_weights[tap], channel_weights_[tap]));
  return {};
}

Status CudnnPerceptual::enqueue(const PerceptualStep& step, cudaStream_t stream) {
  launch_vgg_input(step, input_.data(), stream);
  STGS_TRY(pass(step.patch.width, step.patch.height, stream));
  launch_vgg_gradient(step, input_gradient_, map_parts_.data(), stream);
  launch_vgg_totals(step, sums_.data(), map_parts_.data(), value_.data(), stream);
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
  RecordedPass recorded{width_, height_, {}};
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

Status CudnnPerceptual::convolve_forward(std::size_t layer, const float* input) {
  const float one = 1.0f, zero = 0.0f;
  const Convolution& c = forward_[layer];
  float* output = features_[layer].data();
  return cudnn_.status(cudnn_.convolve_bias_activation(
                           handle_, &one, c.input, input, c.filter, c.weights.data(), convolution_,
                           kAlgorithm, workspace_.data(), workspace_.capacity(), &zero, c.output,
                           output, c.bias_shape, c.bias.data(), relu_, c.output, output),
                       "convolving forward");
}

Status CudnnPerceptual::forward(cudaStream_t stream) {
  const float* in = input_.data();
  for (std::size_t i = 0; i < kLayers; ++i) {
    if (kVggLayers[i].pool_before) {
      launch_vgg_pool(in, sizes_[i - 1], pooled_[i].data(), stream);
      in = pooled_[i].data();
    }
    STGS_TRY(convolve_forward(i, in));
    in = features_[i].data();
  }
  return {};
}

Status CudnnPerceptual::backward(cudaStream_t stream) {
  const float one = 1.0f, zero = 0.0f;
  float *gradient = gradient_.data(), *next = next_gradient_.data();
  for (std::size_t i = kLayers; i-- > 0;) {
    // `gradient` is that of this layer's output, after a pooling if one follows.
    const bool pooled = i + 1 < kLayers && kVggLayers[i + 1].pool_before;
    if (const int tap = kVggLayers[i].tap; tap >= 0) {
      launch_tap_backward({sizes_[i], features_[i].data(), channel_weights_[tap].data(),
                           pooled ? pooled_[i + 1].data() : nullptr, pooled ? gradient : nullptr,
                           next, sums_.data() + tap * kVggBlocks},
                          stream);
      std::swap(gradient, next);
    } else {
      launch_relu_backward(features_[i].data(), sizes_[i], gradient, stream);
    }
    const Convolution& c = backward_[i];
    STGS_TRY(
        cudnn_.status(cudnn_.convolve(handle_, &one, c.input, gradient, c.filter, c.weights.data(),
                                      convolution_, kAlgorithm, workspace_.data(),
                                      workspace_.capacity(), &zero, c.output, next),
                      "convolving backward"));
    std::swap(gradient, next);
  }
  input_gradient_ = gradient;
  return {};
}

// Every pooling follows a tap, whose kernel computes the backward pass of both.
constexpr bool taps_before_pools() {
  for (std::size_t i = 1; i < kLayers; ++i) {
    if (kVggLayers[i].pool_before && kVggLayers[i - 1].tap < 0) return false;
  }
  return kVggLayers[kLayers - 1].tap >= 0;
}
static_assert(taps_before_pools());

}  // namespace

Status check_perceptual_network() {
  return Cudnn::load().status();
}

Result<std::unique_ptr<PerceptualNetwork>> make_perceptual_network(
    std::shared_ptr<const Vgg16> network, VggPrecision precision) {
  auto made = std::make_unique<CudnnPerceptual>(std::move(network));
  STGS_TRY(made->create(precision));
  return std::unique_ptr<PerceptualNetwork>(std::move(made));
}

}  // namespace stgs::encoder::cuda
