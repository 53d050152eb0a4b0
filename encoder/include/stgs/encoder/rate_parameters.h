// SPDX-License-Identifier: Apache-2.0
// Limits of a packed file, which training and packing share.
#pragma once

#include "stgs/format/gaussian4d.h"
#include "stgs/format/parameter.h"

namespace stgs::encoder {

inline constexpr Parameter kTargetKbps = {
    "target_kbps", 0.001,     1e9, "Instead of --quality: the best file within this mean bit rate",
    "kbit/s",      "no limit"};
inline constexpr Parameter kTargetSize = {
    "target_size", 1,         1e15, "Instead of --quality: the best file within this size",
    "bytes",       "no limit"};

inline constexpr Parameter kTargetPsnr = {
    "target_psnr",
    1,
    100,
    "Instead of --quality: the smallest file with this PSNR, of renders against those of the scene "
    "(pack), or of the training images after the best affine colour map of each (train, encode)",
    "dB",
    "no target"};

// Returns the limit of a clip of `frames` frames, bytes; 0: none. Settings: of training or packing.
template <typename Settings>
double byte_limit(const Settings& settings, const TimeBase& time_base, double frames) {
  if (settings.target_size > 0) return settings.target_size;
  return settings.target_kbps * 125.0 * time_base.seconds(frames);
}

// Returns kUsage if more than one of the limits and the target is set.
template <typename Settings>
Status check_limits(const Settings& settings) {
  const int set = (settings.target_kbps > 0 ? 1 : 0) + (settings.target_size > 0 ? 1 : 0) +
                  (settings.target_psnr > 0 ? 1 : 0);
  if (set <= 1) return {};
  return usage_error(
      "--target-kbps, --target-size and --target-psnr exclude each other; use one of them");
}

}  // namespace stgs::encoder
