// SPDX-License-Identifier: Apache-2.0
// The view that each step trains on: every view once per epoch, in a different order per epoch. A
// pure function of seed and step, so the order is known in advance and a resumed run continues it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace stgs::encoder {

class ViewOrder {
 public:
  ViewOrder() = default;
  // views > 0.
  ViewOrder(std::uint64_t seed, std::size_t views) : seed_(seed), views_(views) {}

  // Returns the view of a step. Caches the most recently used epochs.
  std::size_t at(std::uint64_t step);

 private:
  struct Epoch {
    std::uint64_t number = ~std::uint64_t{0};
    std::vector<std::uint32_t> views;
  };

  std::uint64_t seed_ = 0;
  std::size_t views_ = 0;
  std::array<Epoch, 4> epochs_;
};

}  // namespace stgs::encoder
