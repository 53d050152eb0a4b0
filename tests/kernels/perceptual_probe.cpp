// SPDX-License-Identifier: Apache-2.0
// The perceptual loss of two images and its gradient, for compare_networks.py.
// Usage: perceptual_probe WEIGHTS WIDTH HEIGHT RENDERED GROUND_TRUTH GRADIENT [cpu|cuda|cuda-float]
// RENDERED: 3 planes of 32-bit floats; GROUND_TRUTH: RGB, 8 bits; GRADIENT, written: as RENDERED.
// Runs on the CPU, or on CUDA with tensor cores (cuda) or floats (cuda-float). Prints the loss.
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>

#include "perceptual/perceptual_loss.h"
#include "stgs/format/byte_source.h"
#if STGS_HAS_CUDA
#include "backend/cuda/memory.h"
#include "backend/cuda/perceptual_network.h"
#include "train/train_state.h"
#endif

using namespace stgs;
using namespace stgs::encoder;

namespace {

template <typename T>
Status read(const char* path, std::vector<T>& values) {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_file(path));
  return source->read(0,
                      {reinterpret_cast<std::uint8_t*>(values.data()), values.size() * sizeof(T)});
}

#if STGS_HAS_CUDA
Result<double> evaluate_on_cuda(std::shared_ptr<const FeatureNetwork> weights,
                                const Image& rendered, const Image8& ground_truth,
                                cuda::ConvolutionPrecision precision, Image& gradient) {
  const std::size_t pixels = rendered.data.size() / 3;
  cuda::PinnedArray<float4> image, d_image;
  cuda::PinnedArray<std::uint8_t> gpu_ground_truth;
  cuda::PinnedArray<float> map, map_sums;
  STGS_TRY(image.ensure(pixels));
  STGS_TRY(d_image.ensure(pixels));
  STGS_TRY(gpu_ground_truth.ensure(ground_truth.data.size()));
  STGS_TRY(map.ensure(12));
  STGS_TRY(map_sums.ensure(12));
  for (std::size_t i = 0; i < pixels; ++i) {
    image.data()[i] = {rendered.plane(0)[i], rendered.plane(1)[i], rendered.plane(2)[i], 0};
    d_image.data()[i] = {};
  }
  std::copy(ground_truth.data.begin(), ground_truth.data.end(), gpu_ground_truth.data());
  std::copy(kIdentityColour.begin(), kIdentityColour.end(), map.data());
  STGS_ASSIGN(const auto network, cuda::make_perceptual_network(std::move(weights), precision));
  STGS_TRY(network->reserve(rendered.width, rendered.height));
  cuda::Stream stream;
  STGS_TRY(stream.create());
  cuda::PerceptualStep step;
  step.image = image.on_device();
  step.ground_truth = gpu_ground_truth.on_device();
  step.colour_map = map.on_device();
  step.width = rendered.width;
  step.patch = {0, 0, rendered.width, rendered.height};
  step.weight = 1.0f;
  step.d_image = d_image.on_device();
  step.map_sums = map_sums.on_device();
  STGS_TRY(network->enqueue(step, stream));
  STGS_TRY(stream.wait());
  for (std::size_t i = 0; i < pixels; ++i) {
    gradient.plane(0)[i] = d_image.data()[i].x;
    gradient.plane(1)[i] = d_image.data()[i].y;
    gradient.plane(2)[i] = d_image.data()[i].z;
  }
  double value = 0;
  STGS_TRY(
      cuda::cuda_status(cudaMemcpy(&value, network->value(), sizeof(value), cudaMemcpyDeviceToHost),
                        "reading the loss"));
  return value;
}
#endif

Status run(int argc, char** argv) {
  if (argc < 7) return usage_error("needs six arguments");
  const int width = std::atoi(argv[2]), height = std::atoi(argv[3]);
  const std::string backend = argc > 7 ? argv[7] : "cpu";
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(argv[1]));
  STGS_ASSIGN(const std::shared_ptr<const FeatureNetwork> weights,
              read_feature_network(std::move(source), ChannelWeights::kOptional));
  if (!weights->accepts(width, height))
    return usage_error("the image is smaller than {} pixels per side", weights->min_side());
  Image rendered, gradient;
  rendered.reshape(width, height, 3);
  gradient.reshape(width, height, 3);
  std::fill(gradient.data.begin(), gradient.data.end(), 0.0f);
  Image8 ground_truth{width, height, 3, std::vector<std::uint8_t>(rendered.data.size())};
  STGS_TRY(read(argv[4], rendered.data));
  STGS_TRY(read(argv[5], ground_truth.data));
  double value = 0;
  if (backend == "cpu") {
    value = PerceptualLoss(weights).evaluate(rendered, ground_truth, {0, 0, width, height}, 1.0f,
                                             gradient);
  } else {
#if STGS_HAS_CUDA
    STGS_ASSIGN(value,
                evaluate_on_cuda(weights, rendered, ground_truth,
                                 backend == "cuda-float" ? cuda::ConvolutionPrecision::kFloat
                                                         : cuda::ConvolutionPrecision::kTensorCores,
                                 gradient));
#else
    return not_built("this build has no CUDA");
#endif
  }
  std::ofstream file(argv[6], std::ios::binary);
  file.write(reinterpret_cast<const char*>(gradient.data.data()),
             static_cast<std::streamsize>(gradient.data.size() * sizeof(float)));
  std::printf("%.9g\n", value);
  return file.good() ? Status() : io_error("{}: cannot write", argv[6]);
}

}  // namespace

int main(int argc, char** argv) {
  const Status status = run(argc, argv);
  if (!status.ok()) std::fprintf(stderr, "perceptual_probe: %s\n", status.message().c_str());
  return static_cast<int>(status.code());
}
