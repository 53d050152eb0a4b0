// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/cudnn_convolution.h"

#include "perceptual/convolution_backward.h"

namespace stgs::encoder::cuda {
namespace {

// Deterministic, available for all shapes, and supports the tensor cores.
constexpr cudnnConvolutionFwdAlgo_t kAlgorithm = CUDNN_CONVOLUTION_FWD_ALGO_IMPLICIT_PRECOMP_GEMM;

// Converts weights from out x in x taps to out_stored x taps x in_stored, padded with zeros.
std::vector<float> channels_last(const std::vector<float>& weight, int in, int out, int taps,
                                 int in_stored, int out_stored) {
  std::vector<float> weights(std::size_t{1} * taps * in_stored * out_stored);
  for (int o = 0; o < out; ++o) {
    for (int c = 0; c < in; ++c) {
      for (int tap = 0; tap < taps; ++tap)
        weights[(std::size_t{1} * taps * o + tap) * in_stored + c] =
            weight[(std::size_t{1} * o * in + c) * taps + tap];
    }
  }
  return weights;
}

}  // namespace

Status upload_weights(const std::vector<float>& values, DeviceArray<float>& array) {
  STGS_TRY(array.ensure(values.size()));
  constexpr const char* kTask = "uploading the weights of the perceptual loss";
  STGS_TRY(cuda_status(cudaMemcpy(array.data(), values.data(), values.size() * sizeof(float),
                                  cudaMemcpyHostToDevice),
                       kTask));
  // A copy from pageable memory may return before its end, and other streams do not wait for it.
  return cuda_status(cudaStreamSynchronize(cudaStreamLegacy), kTask);
}

Status CudnnConvolution::create_forward(const Cudnn& cudnn, const FeatureStage& stage, int in,
                                        cudnnMathType_t math) {
  const int taps = stage.window.size * stage.window.size;
  weight_ = channels_last(stage.weight, stage.in, stage.out, taps, in, stage.out);
  bias_ = stage.bias;
  return describe(cudnn, stage.window, in, stage.out, math);
}

Status CudnnConvolution::create_backward(const Cudnn& cudnn, const FeatureStage& stage, int in,
                                         cudnnMathType_t math) {
  const int taps = stage.window.size * stage.window.size;
  weight_ = channels_last(flipped_weights(stage.weight, stage.in, stage.out, taps), stage.out,
                          stage.in, taps, stage.out, in);
  return describe(cudnn, backward_window(stage.window), stage.out, in, math);
}

Status CudnnConvolution::describe(const Cudnn& cudnn, const Window& window, int in, int out,
                                  cudnnMathType_t math) {
  const char* operation = "describing a layer";
  cudnn_ = &cudnn;
  weight_count_ = weight_.size();
  bias_count_ = bias_.size();
  STGS_TRY(cudnn.status(convolution_.create(cudnn.create_convolution, cudnn.destroy_convolution),
                        operation));
  STGS_TRY(cudnn.status(
      cudnn.set_convolution(convolution_, window.padding, window.padding, window.stride,
                            window.stride, 1, 1, CUDNN_CROSS_CORRELATION, CUDNN_DATA_FLOAT),
      operation));
  STGS_TRY(cudnn.status(cudnn.set_math_type(convolution_, math), "choosing the precision"));
  for (auto* tensor : {&input_, &output_, &bias_shape_})
    STGS_TRY(cudnn.status(tensor->create(cudnn.create_tensor, cudnn.destroy_tensor), operation));
  STGS_TRY(cudnn.status(filter_.create(cudnn.create_filter, cudnn.destroy_filter), operation));
  STGS_TRY(cudnn.status(cudnn.set_filter(filter_, CUDNN_DATA_FLOAT, CUDNN_TENSOR_NHWC, out, in,
                                         window.size, window.size),
                        operation));
  return cudnn.status(
      cudnn.set_tensor(bias_shape_, CUDNN_TENSOR_NHWC, CUDNN_DATA_FLOAT, 1, out, 1, 1), operation);
}

Status CudnnConvolution::set_size(int images, const FeatureSize& input, const FeatureSize& output) {
  const char* operation = "describing a layer's size";
  STGS_TRY(cudnn_->status(cudnn_->set_tensor(input_, CUDNN_TENSOR_NHWC, CUDNN_DATA_FLOAT, images,
                                             input.channels, input.height, input.width),
                          operation));
  return cudnn_->status(cudnn_->set_tensor(output_, CUDNN_TENSOR_NHWC, CUDNN_DATA_FLOAT, images,
                                           output.channels, output.height, output.width),
                        operation);
}

Result<std::size_t> CudnnConvolution::workspace_bytes(cudnnHandle_t handle) const {
  std::size_t bytes = 0;
  STGS_TRY(cudnn_->status(
      cudnn_->workspace_size(handle, input_, filter_, convolution_, output_, kAlgorithm, &bytes),
      "querying the workspace size"));
  return bytes;
}

Status CudnnConvolution::upload() {
  if (weight_.empty()) return {};
  STGS_TRY(upload_weights(weight_, device_weight_));
  if (bias_count_ > 0) STGS_TRY(upload_weights(bias_, device_bias_));
  weight_ = {};
  bias_ = {};
  return {};
}

Status CudnnConvolution::apply(cudnnHandle_t handle, cudnnActivationDescriptor_t relu,
                               const float* input, const CudnnWorkspace& workspace,
                               float* output) const {
  const float one = 1.0f, zero = 0.0f;
  if (bias_count_ == 0) {
    return cudnn_->status(
        cudnn_->convolve(handle, &one, input_, input, filter_, device_weight_.data(), convolution_,
                         kAlgorithm, workspace.data, workspace.bytes, &zero, output_, output),
        "convolving backward");
  }
  return cudnn_->status(
      cudnn_->convolve_bias_activation(handle, &one, input_, input, filter_, device_weight_.data(),
                                       convolution_, kAlgorithm, workspace.data, workspace.bytes,
                                       &zero, output_, output, bias_shape_, device_bias_.data(),
                                       relu, output_, output),
      "convolving forward");
}

}  // namespace stgs::encoder::cuda
