// SPDX-License-Identifier: Apache-2.0
// The kernels of motion detection (geometry/motion_finder.h). All pointers are of device memory.
// Nothing here waits; check cudaGetLastError() afterwards.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "geometry/motion_rule.h"

namespace stgs::encoder::cuda {

using geometry::Vec2;

struct MotionSize {
  int width, height;
  int pixels() const { return width * height; }
};

// The images of consecutive frames. Image k is in slot (first + k) modulo `slots`, so that the
// last of a chunk is the first of the next without a copy.
struct MotionSlots {
  int first, slots;
  STGS_FN std::size_t at(int k) const { return static_cast<std::size_t>((first + k) % slots); }
};

// The samples of a median, one after the other.
struct DeviceSamples {
  const std::uint8_t* rgb;
  const std::uint8_t* masks;  // null: all pixels count
  int count;
};

// Writes the median of the pixels that count, 0 or 255 for whether any does, and adds the median
// absolute deviations of green to 256 counts.
void launch_median(MotionSize size, const DeviceSamples& samples, std::uint8_t* colour,
                   std::uint8_t* valid, std::uint32_t* deviations, cudaStream_t stream);

// The background that frames are compared with.
struct DeviceBackground {
  std::uint8_t* colour;   // RGB
  std::uint8_t* blurred;  // RGB
  std::uint8_t *grey, *blurred_grey;
  float* threshold;  // of a change that counts
};

// Writes all but `colour`. `base`: geometry::threshold_base().
void launch_background(MotionSize size, const DeviceBackground& background, float base,
                       cudaStream_t stream);

// The masks of the frames of a chunk, each of the size of the image.
struct MotionMasks {
  int frames;
  const std::uint8_t* rgb;  // in slots
  MotionSlots slots;
  std::uint8_t* weak;          // pixels that may be dynamic, then scratch
  std::uint8_t* strong;        // those that certainly are
  std::uint8_t* mask;          // the result
  const std::uint8_t* moving;  // by the flow from the frame before the first on; one more mask
  int* labels;                 // of components, scratch
  int* areas;                  // scratch
  int* masked;                 // per frame, pixels; zero before launch_masks()
};

// Writes `weak` and `strong`.
void launch_changes(MotionSize size, const DeviceBackground& background, const MotionMasks& masks,
                    cudaStream_t stream);
// Writes `mask` and `masked` from them (mask_cleaning.cu).
void launch_masks(MotionSize size, const MotionMasks& masks, cudaStream_t stream);

// The flow of the pairs of a chunk, at all pixels; NaN where it is unknown.
struct CheckedFlow {
  int pairs;
  Vec2* flow;
  std::uint32_t* lengths;  // kLengthBins per pair; zero before they are counted
};

// Counts the lengths of flow at every second pixel of every second row.
void launch_flow_lengths(MotionSize size, const CheckedFlow& flow, cudaStream_t stream);

// Writes 255 where the flow is clearly longer than that of static pixels, else 0.
void launch_moving(MotionSize size, const CheckedFlow& flow, std::uint8_t* moving,
                   cudaStream_t stream);

// Writes FrameMotion::flow.
void launch_pack_flow(MotionSize size, const CheckedFlow& flow, const std::uint8_t* masks,
                      std::int16_t* packed, cudaStream_t stream);

// Components of masks (components.cu): writes 255 for the pixels of `mask` in components with 8
// neighbours that have at least `smallest` pixels and one of `seeds`, else 0. `out` is not `mask`.
void launch_select_components(MotionSize size, int frames, const std::uint8_t* mask,
                              const std::uint8_t* seeds, int smallest, int* labels, int* areas,
                              std::uint8_t* out, cudaStream_t stream);

// Fills holes of at most `largest` pixels, with 4 neighbours, that are not at the border.
void launch_fill_holes(MotionSize size, int frames, std::uint8_t* mask, int largest, int* labels,
                       int* areas, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
