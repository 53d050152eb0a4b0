// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/lpips.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "perceptual/feature_network.h"
#include "perceptual/network_input.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder {
namespace {

constexpr float kEpsilon = 1e-10f;  // added to the length of the features of a pixel

void load(const Image& image, FeatureMap& out) {
  const auto colour = [&image](int x, int y, int c) {
    return image.plane(c)[std::size_t{1} * y * image.width + x];
  };
  load_network_input(image.width, image.height, colour, out);
}

// Returns the factor that makes the features of a pixel a vector of length 1.
float scale_of(const float* features, int channels) {
  float square = 0.0f;
  for (int c = 0; c < channels; ++c) square += features[c] * features[c];
  return 1.0f / (std::sqrt(square) + kEpsilon);
}

// Returns the distance at a tap.
double tap_distance(const FeatureMap& a, const FeatureMap& b, const std::vector<float>& weights) {
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

// A stage without the weights that a convolution has in another order.
struct Stage {
  std::optional<Convolution> convolution;  // with ReLU; otherwise a pooling
  Window window;
  int in = 0, out = 0;  // channels
  std::vector<float> channel_weights;
};

class Network final : public Lpips {
 public:
  Network(std::string file, const FeatureNetwork& network)
      : name_(network.name), file_(std::move(file)), min_side_(network.min_side()) {
    for (const FeatureStage& from : network.stages) {
      Stage& stage =
          stages_.emplace_back(Stage{{}, from.window, from.in, from.out, from.channel_weights});
      if (!from.is_pooling())
        stage.convolution.emplace(from.weight, from.bias, from.in, from.out, from.window);
    }
  }

  std::string network() const override { return name_; }

  Status check_size(int width, int height) const override {
    if (std::min(width, height) >= min_side_) return {};
    return unsupported("LPIPS ({0}) needs images of at least {1}x{1} pixels (got {2}x{3})", name_,
                       min_side_, width, height);
  }

  std::uint64_t working_bytes(int width, int height) const override {
    const auto bytes_of = [](int w, int h, int channels) {
      return sizeof(float) * static_cast<std::uint64_t>(w + 2) * static_cast<std::uint64_t>(h + 2) *
             static_cast<std::uint64_t>(channels);
    };
    std::uint64_t most = 0, before = 2 * bytes_of(width, height, 3);
    for (const Stage& stage : stages_) {
      width = stage.window.count(width);
      height = stage.window.count(height);
      const bool gathers = stage.convolution && stage.convolution->gathers();
      const int taps = gathers ? stage.window.size * stage.window.size : 0;
      const std::uint64_t after = 2 * bytes_of(width, height, stage.out);
      most = std::max(most, before + after + bytes_of(width, height, taps * stage.in));
      before = after;
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
      if (!stage.channel_weights.empty())
        out += tap_distance(maps[0], maps[1], stage.channel_weights);
    }
    if (!std::isfinite(out)) return invalid_file("{}: the weights are too large", file_);
    return out;
  }

 private:
  std::string name_, file_;
  int min_side_;
  std::vector<Stage> stages_;
};

}  // namespace

Result<std::shared_ptr<const Lpips>> Lpips::read(std::unique_ptr<ByteSource> source) {
  std::string file = source->name();
  STGS_ASSIGN(const std::shared_ptr<const FeatureNetwork> network,
              read_feature_network(std::move(source), ChannelWeights::kRequired));
  return std::shared_ptr<const Lpips>(std::make_shared<Network>(std::move(file), *network));
}

}  // namespace stgs::encoder
