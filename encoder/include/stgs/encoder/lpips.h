// SPDX-License-Identifier: Apache-2.0
// LPIPS (Zhang et al., The Unreasonable Effectiveness of Deep Features as a Perceptual Metric, CVPR
// 2018), version 0.1: the distance of two images in the features of a network.
//
//   d = sum over taps of the mean over pixels of sum_c w_c (a_c - b_c)^2
//
// where a and b are the features of the two images, normalised per pixel, and w are the channel
// weights of the tap, which are trained on human judgements.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "stgs/format/byte_source.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Safe to use from several threads; each call uses all threads itself.
class Lpips {
 public:
  // Reads a network from a safetensors file: SqueezeNet 1.1, VGG16 or AlexNet, by torchvision's
  // names of tensors (features.N.weight, features.N.bias), with LPIPS's channel weights
  // (lin0.model.1.weight and so on). kInvalidFile names the file, and the tensor if a bias or
  // channel weight is missing or a tensor is invalid; a file without all the weights of a network
  // is invalid.
  static Result<std::shared_ptr<const Lpips>> read(std::unique_ptr<ByteSource> source);

  virtual ~Lpips() = default;
  // Returns "squeeze", "vgg" or "alex".
  virtual std::string network() const = 0;
  // kUnsupported if images of this size are smaller than the network allows.
  virtual Status check_size(int width, int height) const = 0;
  // Returns the memory that distance() needs for images that pass check_size(), bytes.
  virtual std::uint64_t working_bytes(int width, int height) const = 0;
  // Returns the distance of two images of the same size that passes check_size(), planar RGB in
  // [0,1]. kInvalidFile if the weights are so large that it is not finite.
  virtual Result<double> distance(const Image& a, const Image& b) const = 0;
};

}  // namespace stgs::encoder
