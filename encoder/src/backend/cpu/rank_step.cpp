// SPDX-License-Identifier: Apache-2.0
#include "backend/cpu/rank_step.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>

#include "backend/cpu/block.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster_view.h"
#include "train/colour_correction.h"

namespace stgs::encoder::cpu {
namespace {

using raster::read3;

constexpr std::uint32_t kNotVisible = 0xFFFFFFFFu;  // in a view
constexpr std::size_t kMaxShValues = std::size_t{3} * 16;

// Sent before the numbers, because it states their count.
struct Head {
  std::uint64_t primitives = 0;
  StepOutput output;
  ColourMap by_colour_map{};
};
static_assert(std::is_trivially_copyable_v<Head> && sizeof(Head) % 4 == 0);

// Returns each primitive's index in a view's contributions, or kNotVisible.
std::vector<std::uint32_t> entries_of(const ViewContribution& view, std::size_t primitives) {
  std::vector<std::uint32_t> entries(primitives, kNotVisible);
  for (std::size_t s = 0; s < view.ids.size(); ++s) {
    if (view.ids[s] < primitives) entries[view.ids[s]] = static_cast<std::uint32_t>(s);
  }
  return entries;
}

// Returns the SH basis for the direction from a camera to a primitive.
math::ShBasis basis_in(const Gaussians4D& set, std::size_t i, const BatchView& view) {
  const math::Vec3 position =
      math::position_at(read3(set.position, i), read3(set.velocity, i), view.ticks - set.time[i]);
  const math::Vec3 from_camera{position.x - view.centre.x, position.y - view.centre.y,
                               position.z - view.centre.z};
  const float inverse = 1.0f / std::sqrt(math::dot3(from_camera, from_camera));
  return math::sh_basis(
      {from_camera.x * inverse, from_camera.y * inverse, from_camera.z * inverse});
}

// Sums the contributions of the views to one primitive.
class Sum {
 public:
  explicit Sum(const ContributionLayout& layout) : layout_(layout) {}

  void add(const float* numbers, const math::ShBasis& basis, int coefficients) {
    for (std::size_t k = 0; k < layout_.statistics; ++k) numbers_[k] += numbers[k];
    const float* colour = numbers + layout_.at[kSh];
    for (int k = 0; k < coefficients; ++k) {
      for (int c = 0; c < 3; ++c) sh_[3 * k + c] += basis.v[k] * colour[c];
    }
  }
  // Returns the mean gradients over `views` views.
  LearntGradients mean(std::size_t views, int coefficients) {
    const float factor = 1.0f / static_cast<float>(views);
    for (float& x : numbers_) x *= factor;
    for (float& x : sh_) x *= factor;
    LearntGradients gradients;
    gradients.coefficients = coefficients;
    for (int a = 0; a < kAttributes; ++a) gradients.by[a] = numbers_.data() + layout_.at[a];
    gradients.by[kSh] = sh_.data();
    return gradients;
  }

 private:
  const ContributionLayout& layout_;
  std::array<float, 32> numbers_{};
  std::array<float, kMaxShValues> sh_{};
};

}  // namespace

ContributionLayout::ContributionLayout(const TrainState& state) {
  for (int a = 0; a < kAttributes; ++a) {
    at[a] = size;
    components[a] = a == kSh ? 3 : static_cast<std::size_t>(state.components(a));
    size += components[a];
  }
  statistics = size;
  size += 3;
}

void ViewContribution::resize(std::size_t primitives, const ContributionLayout& layout) {
  ids.resize(primitives);
  numbers.resize(primitives * layout.size);
}

void ViewContribution::set(std::size_t s, const ContributionLayout& layout,
                           const LearntGradients& gradients, math::Vec3 by_colour,
                           const ViewStatistics& statistics) {
  float* to = numbers.data() + s * layout.size;
  for (int a = 0; a < kAttributes; ++a) {
    if (a != kSh) std::copy_n(gradients.by[a], layout.components[a], to + layout.at[a]);
  }
  float* colour = to + layout.at[kSh];
  colour[0] = by_colour.x;
  colour[1] = by_colour.y;
  colour[2] = by_colour.z;
  float* rest = to + layout.statistics;
  rest[0] = statistics.gradient;
  rest[1] = statistics.abs_gradient;
  rest[2] = statistics.error;
}

Result<std::vector<ViewContribution>> gather_contributions(Ranks& ranks,
                                                           const ContributionLayout& layout,
                                                           const ViewContribution& own) {
  const auto count = static_cast<std::size_t>(ranks.size());
  std::vector<Head> heads(count);
  const Head head{own.ids.size(), own.output, own.by_colour_map};
  STGS_TRY(ranks.all_gather(&head, sizeof(Head), heads.data()));
  std::size_t max_primitives = 0;
  for (const Head& h : heads) max_primitives = std::max<std::size_t>(max_primitives, h.primitives);
  // Words per rank: the ids, then the numbers, padded to the largest count.
  const std::size_t words = max_primitives * (1 + layout.size);
  std::vector<std::uint32_t> sent(words), received(words * count);
  std::copy(own.ids.begin(), own.ids.end(), sent.begin());
  if (!own.ids.empty()) {
    std::memcpy(sent.data() + max_primitives, own.numbers.data(),
                own.numbers.size() * sizeof(float));
  }
  STGS_TRY(ranks.all_gather(sent.data(), words * sizeof(std::uint32_t), received.data()));
  std::vector<ViewContribution> views;
  for (std::size_t r = 0; r < count; ++r) {
    ViewContribution& view = views.emplace_back();
    view.output = heads[r].output;
    view.by_colour_map = heads[r].by_colour_map;
    view.resize(heads[r].primitives, layout);
    const std::uint32_t* from = received.data() + r * words;
    std::copy_n(from, view.ids.size(), view.ids.begin());
    if (view.ids.empty()) continue;
    std::memcpy(view.numbers.data(), from + max_primitives, view.numbers.size() * sizeof(float));
  }
  return views;
}

void apply_contributions(TrainState& state, const Gaussians4D& rendered, const StepInput& input,
                         const std::vector<ViewContribution>& views) {
  const ContributionLayout layout(state);
  const int coefficients =
      math::sh_coefficients(std::clamp(input.sh_degree, 0, state.set.sh_degree));
  std::vector<std::vector<std::uint32_t>> entries(views.size());
  parallel_for(std::size_t{0}, views.size(),
               [&](std::size_t r) { entries[r] = entries_of(views[r], state.size()); });
  parallel_blocks(std::size_t{0}, state.size(), kBlock, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      if (state.is_fixed(i)) continue;
      Sum sum(layout);
      bool visible = false;
      for (std::size_t r = 0; r < views.size(); ++r) {
        const std::uint32_t s = entries[r][i];
        if (s == kNotVisible) continue;
        const float* numbers = views[r].numbers.data() + s * layout.size;
        const float* rest = numbers + layout.statistics;
        sum.add(numbers, basis_in(rendered, i, input.batch[r]), coefficients);
        if (input.gather_statistics) gather_statistics(state, i, {rest[0], rest[1], rest[2]});
        visible = true;
      }
      if (visible) adam_primitive(state, i, sum.mean(views.size(), coefficients), input);
    }
  });
  for (std::size_t r = 0; r < views.size(); ++r) {
    update_colour(state, input.batch[r].colour_index, views[r].by_colour_map, input.rate_colour);
  }
}

}  // namespace stgs::encoder::cpu
