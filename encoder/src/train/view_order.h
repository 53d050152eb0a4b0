// SPDX-License-Identifier: Apache-2.0
// Which view each step of a training takes: all of them once an epoch, each epoch in an order of
// its own. A pure function of seed and step, so that the order is known ahead and a resumed run
// goes on in it.
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

  // The view of a step. Remembers the last few epochs asked for.
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
