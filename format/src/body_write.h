// SPDX-License-Identifier: Apache-2.0
// The records of a scene's segments, and the layouts that they share.
#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

#include "container.h"
#include "quantise.h"
#include "segmenter.h"

namespace stgs {

// How a scene is written, and what of.
struct Encoding {
  const Gaussians4D* set = nullptr;
  std::span<const float> importance;  // empty: lossless, one tier
  const Quantiser* quantiser = nullptr;
  double chunk_ticks = 0;
  int tiers = 1, zstd_level = 9;
  Coder coder = Coder::kBytes;
  bool draco = false;        // codes the positions
  bool own_layouts = false;  // each record has its own
  std::stop_token stop;      // encode_body throws where it is asked to
};

struct Body {
  FileIndex index;
  LayoutSet layouts;
  std::vector<PartEntry> parts;
  std::vector<std::vector<std::uint8_t>> bases, harmonics;  // records, by segment
  std::vector<std::uint8_t> importance;                     // record, or empty
  std::vector<std::uint32_t> order;  // index in the scene of each primitive of the file
};

Body encode_body(const Encoding& encoding, const std::vector<PartRange>& parts);

}  // namespace stgs
