// SPDX-License-Identifier: Apache-2.0
// Encoding of a scene's segments into records, and of the layouts that they share.
#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

#include "container/container.h"
#include "quantise/quantise.h"
#include "quantise/segmenter.h"
#include "quantise/tiers.h"
#include "scene/coding_errors.h"

namespace stgs {

// The input of encode_body(). Pointers and spans are not owned.
struct Encoding {
  const Gaussians4D* set = nullptr;
  const Gaussians4D* source = nullptr;   // measure the differences to this set; null: do not
  std::span<const float> importance;     // empty: lossless, one tier
  const Quantiser* quantiser = nullptr;  // null: lossless
  double chunk_ticks = 0;
  std::vector<std::vector<SegmentMembers>> segments;  // by part
  TierPlan tiers;
  Coder coder = Coder::kBytes;
  bool draco = false;        // code positions with Draco
  bool own_layouts = false;  // each record contains its layout
  std::stop_token stop;      // encode_body() throws std::runtime_error if a stop is requested
};

struct Body {
  FileIndex index;
  LayoutSet layouts;
  std::vector<PartEntry> parts;
  std::vector<std::vector<std::uint8_t>> bases, sh;  // records, by segment
  std::vector<std::uint32_t>
      order;            // of the primitives, segment after segment: indices in the scene
  CodingErrors errors;  // if Encoding has a source
};

// Encodes all segments of these parts, on all threads.
Body encode_body(const Encoding& encoding, const std::vector<PartRange>& parts);

}  // namespace stgs
