// SPDX-License-Identifier: Apache-2.0
// The table (stgs/format/parameter.h) of stgs_record_settings: numbers of pack with another meaning
// of 0, because a recording has no scene to choose them from.
#pragma once

#include "stgs/encoder/pack.h"

namespace stgs::sdk {

constexpr Parameter with_zero(Parameter parameter, const char* zero) {
  parameter.zero = zero;
  return parameter;
}

struct RecordParameters {
  template <typename Visit>
  static void for_each(Visit visit) {
    visit(kTiers, STGS_MEMBER(tiers));
    visit(kQuality, STGS_MEMBER(quality));
    visit(encoder::kMaxError, STGS_MEMBER(max_error));
    visit(with_zero(encoder::kChunkSeconds, "a choice by the first fragment"),
          STGS_MEMBER(chunk_seconds));
    visit(with_zero(encoder::kMetresPerUnit, "an unknown scale"), STGS_MEMBER(metres_per_unit));
    visit(encoder::kAudioBegin, STGS_MEMBER(audio_begin));
  }
};

}  // namespace stgs::sdk
