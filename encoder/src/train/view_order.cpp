// SPDX-License-Identifier: Apache-2.0
#include "train/view_order.h"

#include <numeric>
#include <utility>

#include "train/random.h"

namespace stgs::encoder {

std::size_t ViewOrder::at(std::uint64_t step) {
  const std::uint64_t number = step / views_;
  Epoch& epoch = epochs_[number % epochs_.size()];
  if (epoch.number != number) {
    epoch.number = number;
    epoch.views.resize(views_);
    std::iota(epoch.views.begin(), epoch.views.end(), 0u);
    Random random(seed_, number, RandomPurpose::kViews);
    for (std::size_t i = views_ - 1; i > 0; --i) {
      std::swap(epoch.views[i], epoch.views[random.below(i + 1)]);
    }
  }
  return epoch.views[step % views_];
}

}  // namespace stgs::encoder
