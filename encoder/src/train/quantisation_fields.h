// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "stgs/format/quantisation.h"

namespace stgs::encoder {

// Visits the fields of the steps of a training run in file order, for writing, reading and hashing.
template <typename Archive>
void visit_quantisation(Quantisation& q, Archive& archive) {
  archive.value(q.quality);
  archive.value(q.max_error);
  archive.value(q.longest_part);
  archive.value(q.lifespans);
  archive.value(q.opacity);
  archive.value(q.middle);
  archive.value(q.near_distance);
  archive.value(q.near_displacement);
  archive.array(q.bounds);
  std::uint8_t graded = q.graded ? 1 : 0;  // reading any other byte into a bool is undefined
  archive.value(graded);
  archive.array(q.tiers);
  q.graded = graded != 0;
}

}  // namespace stgs::encoder
