// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/lpips.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "perceptual/convolution.h"
#include "perceptual/lpips_networks.h"
#include "perceptual/safetensors.h"
#include "perceptual/vgg_layers.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder {
namespace {

using Kind = LpipsLayer::Kind;
using Values = std::vector<float>;

constexpr float kEpsilon = 1e-10f;  // added to the length of the features of a pixel

// A step of a network with its weights.
struct Stage {
  std::optional<Convolution> convolution;  // with ReLU; otherwise a pooling
  Window window;
  int channels = 0;  // of its output
  Values weights;    // of the channels, if the features after it are compared
};

// Reads the convolution of this name. `window`: its own.
Status read_convolution(const Safetensors& file, const std::string& name, int in, int out,
                        const Window& window, Values& weight, Values& bias) {
  const auto size = static_cast<std::uint64_t>(window.size);
  const auto inputs = static_cast<std::uint64_t>(in), outputs = static_cast<std::uint64_t>(out);
  STGS_ASSIGN(weight, file.floats(name + ".weight", std::array{outputs, inputs, size, size}));
  STGS_ASSIGN(bias, file.floats(name + ".bias", std::array{outputs}));
  return {};
}

// Returns the weights of 1x1 windows as those of 3x3 windows with the same results.
Values in_centre(const Values& weight) {
  Values out(9 * weight.size(), 0.0f);
  for (std::size_t i = 0; i < weight.size(); ++i) out[9 * i + 4] = weight[i];
  return out;
}

Stage make_stage(const Values& weight, const Values& bias, int in, const Window& window) {
  Stage out;
  out.channels = static_cast<int>(bias.size());
  out.window = window;
  out.convolution.emplace(weight, bias, in, out.channels, window);
  return out;
}

// Reads a fire module as two stages: the first convolution, and the other two as one.
Status read_fire(const Safetensors& file, const std::string& name, const LpipsLayer& layer,
                 std::vector<Stage>& stages) {
  constexpr Window kOne{1, 1, 0}, kThree;
  Values weight, bias, more_weight, more_bias;
  STGS_TRY(read_convolution(file, name + ".squeeze", layer.in, layer.squeezed, kOne, weight, bias));
  stages.push_back(make_stage(weight, bias, layer.in, kOne));
  const int half = layer.out / 2;
  STGS_TRY(read_convolution(file, name + ".expand1x1", layer.squeezed, half, kOne, weight, bias));
  STGS_TRY(read_convolution(file, name + ".expand3x3", layer.squeezed, half, kThree, more_weight,
                            more_bias));
  weight = in_centre(weight);
  weight.insert(weight.end(), more_weight.begin(), more_weight.end());
  bias.insert(bias.end(), more_bias.begin(), more_bias.end());
  stages.push_back(make_stage(weight, bias, layer.squeezed, kThree));
  return {};
}

Status read_layer(const Safetensors& file, const LpipsLayer& layer, std::vector<Stage>& stages) {
  const std::string name = fmt::format("features.{}", layer.feature);
  if (layer.kind == Kind::kFire) return read_fire(file, name, layer, stages);
  if (layer.kind == Kind::kPooling) {
    const int channels = stages.back().channels;
    stages.push_back({std::nullopt, layer.window, channels, {}});
    return {};
  }
  Values weight, bias;
  STGS_TRY(read_convolution(file, name, layer.in, layer.out, layer.window, weight, bias));
  stages.push_back(make_stage(weight, bias, layer.in, layer.window));
  return {};
}

// Reads the weights of the channels of a tap.
Result<Values> read_channel_weights(const Safetensors& file, int tap, int channels) {
  const std::string name = fmt::format("lin{}.model.1.weight", tap);
  constexpr std::uint64_t kOne = 1;
  const std::array shape{kOne, static_cast<std::uint64_t>(channels), kOne, kOne};
  STGS_ASSIGN(Values weights, file.floats(name, shape));
  if (*std::min_element(weights.begin(), weights.end()) < 0.0f) {
    return invalid_file("{}: tensor '{}': negative channel weight (expected >= 0)", file.name(),
                        name);
  }
  return weights;
}

Result<std::vector<Stage>> read_stages(const Safetensors& file, const LpipsNetwork& network) {
  std::vector<Stage> stages;
  int tap = 0;
  for (const LpipsLayer& layer : network.layers) {
    STGS_TRY(read_layer(file, layer, stages));
    if (!layer.tap) continue;
    STGS_ASSIGN(stages.back().weights, read_channel_weights(file, tap++, layer.out));
  }
  return stages;
}

// Returns the network to which the tensors of a file belong.
Result<LpipsNetwork> network_of(const Safetensors& file) {
  for (const LpipsNetwork& network : lpips_networks()) {
    const auto has_layer = [&](const LpipsLayer& layer) {
      const char* const part = layer.kind == Kind::kFire ? ".squeeze" : "";
      return layer.kind == Kind::kPooling ||
             file.contains(fmt::format("features.{}{}.weight", layer.feature, part));
    };
    if (std::all_of(network.layers.begin(), network.layers.end(), has_layer)) return network;
  }
  return invalid_file(
      "{}: not a network of LPIPS (expected the tensors of SqueezeNet 1.1, VGG16 or AlexNet under "
      "torchvision's names, features.N.weight, and lin0.model.1.weight and so on)",
      file.name());
}

// Loads an image as the input of a network.
void load(const Image& image, FeatureMap& out) {
  out.reshape(image.width, image.height, 3);
  parallel_for(0, image.height, [&](int y) {
    for (int x = 0; x < image.width; ++x) {
      float* const to = out.pixel(x, y);
      for (int c = 0; c < 3; ++c) {
        const float value = image.plane(c)[std::size_t{1} * y * image.width + x];
        to[c] = (value - kVggMean[c]) / kVggDeviation[c];
      }
    }
  });
}

// Returns the factor that makes the features of a pixel a vector of length 1.
float scale_of(const float* features, int channels) {
  float square = 0.0f;
  for (int c = 0; c < channels; ++c) square += features[c] * features[c];
  return 1.0f / (std::sqrt(square) + kEpsilon);
}

// Returns the distance at a tap.
double tap_distance(const FeatureMap& a, const FeatureMap& b, const Values& weights) {
  std::vector<double> rows(static_cast<std::size_t>(a.height));
  parallel_for(0, a.height, [&](int y) {
    for (int x = 0; x < a.width; ++x) {
      const float *const f = a.pixel(x, y), *const g = b.pixel(x, y);
      const float scale_f = scale_of(f, a.channels), scale_g = scale_of(g, a.channels);
      float sum = 0.0f;
      for (int c = 0; c < a.channels; ++c) {
        const float difference = f[c] * scale_f - g[c] * scale_g;
        sum += weights[static_cast<std::size_t>(c)] * difference * difference;
      }
      rows[static_cast<std::size_t>(y)] += sum;
    }
  });
  double sum = 0;
  for (const double row : rows) sum += row;
  return sum / (static_cast<double>(a.width) * a.height);
}

class Network final : public Lpips {
 public:
  Network(std::string name, std::string file, std::vector<Stage> stages)
      : name_(std::move(name)), file_(std::move(file)), stages_(std::move(stages)) {}

  std::string network() const override { return name_; }

  Status check_size(int width, int height) const override {
    if (is_allowed(width, height)) return {};
    int side = 1;
    while (!is_allowed(side, side)) ++side;
    return unsupported("LPIPS ({0}) needs images of at least {1}x{1} pixels (got {2}x{3})", name_,
                       side, width, height);
  }

  std::uint64_t working_bytes(int width, int height) const override {
    const auto bytes_of = [](int w, int h, int channels) {
      return sizeof(float) * static_cast<std::uint64_t>(w + 2) * static_cast<std::uint64_t>(h + 2) *
             static_cast<std::uint64_t>(channels);
    };
    std::uint64_t most = 0, before = 2 * bytes_of(width, height, 3);
    int channels = 3;
    for (const Stage& stage : stages_) {
      width = stage.window.count(width);
      height = stage.window.count(height);
      const bool gathers = stage.convolution && stage.convolution->gathers();
      const int taps = gathers ? stage.window.size * stage.window.size : 0;
      const std::uint64_t after = 2 * bytes_of(width, height, stage.channels);
      most = std::max(most, before + after + bytes_of(width, height, taps * channels));
      before = after;
      channels = stage.channels;
    }
    return most;
  }

  Result<double> distance(const Image& a, const Image& b) const override {
    STGS_TRY(check_size(a.width, a.height));
    std::array<FeatureMap, 2> maps;
    load(a, maps[0]);
    load(b, maps[1]);
    double out = 0;
    for (const Stage& stage : stages_) {
      for (FeatureMap& map : maps) {
        FeatureMap next;
        if (stage.convolution) {
          stage.convolution->apply(map, true, next);
        } else {
          max_pool(map, stage.window, next);
        }
        map = std::move(next);
      }
      if (!stage.weights.empty()) out += tap_distance(maps[0], maps[1], stage.weights);
    }
    if (!std::isfinite(out)) return invalid_file("{}: the weights are too large", file_);
    return out;
  }

 private:
  bool is_allowed(int width, int height) const {
    for (const Stage& stage : stages_) {
      width = stage.window.count(width);
      height = stage.window.count(height);
    }
    return width > 0 && height > 0;
  }

  std::string name_, file_;
  std::vector<Stage> stages_;
};

}  // namespace

Result<std::shared_ptr<const Lpips>> Lpips::read(std::unique_ptr<ByteSource> source) {
  STGS_ASSIGN(const Safetensors file, Safetensors::open(std::move(source)));
  STGS_ASSIGN(const LpipsNetwork network, network_of(file));
  STGS_ASSIGN(std::vector<Stage> stages, read_stages(file, network));
  return std::shared_ptr<const Lpips>(
      std::make_shared<Network>(network.name, file.name(), std::move(stages)));
}

}  // namespace stgs::encoder
