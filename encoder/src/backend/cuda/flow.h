// SPDX-License-Identifier: Apache-2.0
// The kernels of dense optical flow (geometry/flow_rule.h) between consecutive frames, in both
// directions at a time. All pointers are of device memory. Nothing here waits; check
// cudaGetLastError() afterwards.
#pragma once

#include <cuda_runtime_api.h>

#include "backend/cuda/motion.h"
#include "geometry/flow_rule.h"

namespace stgs::encoder::cuda {

// The levels of the images in slots: those of a slot are one after the other.
struct FlowPyramid {
  int levels;  // 1 more than the coarsest
  int finest;  // coarser levels have gradients too
  float* grey[geometry::kMaxFlowLevels];
  Vec2* gradient[geometry::kMaxFlowLevels];
  MotionSize size[geometry::kMaxFlowLevels];
};

// Writes the levels of images [first, last) of the slots.
void launch_pyramid(const FlowPyramid& pyramid, const std::uint8_t* rgb, MotionSlots slots,
                    int first, int last, cudaStream_t stream);

// Scratch of a chunk of pairs. Each field has two parts per pair: forward and back.
struct FlowScratch {
  Vec2* field[2];                   // the flow of a level and of the coarser one, in turns
  geometry::PatchFlow* patches[2];  // in turns
};

// Values of a part of a field and of the patches, at the level where they are most.
std::size_t flow_field_values(const FlowPyramid& pyramid);
std::size_t flow_patches(const FlowPyramid& pyramid);

// Writes the flow of the pairs (k, k + 1) of images in the slots.
void launch_flow(MotionSize size, const FlowPyramid& pyramid, MotionSlots slots,
                 const FlowScratch& scratch, const CheckedFlow& flow, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
