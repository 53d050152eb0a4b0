// SPDX-License-Identifier: Apache-2.0
// Motion detection of one camera at a time on a GPU.
#pragma once

#include <vector>

#include "backend/cuda/flow.h"
#include "backend/cuda/memory.h"
#include "backend/cuda/motion.h"
#include "geometry/motion_finder.h"

namespace stgs::encoder::cuda {

inline constexpr int kMotionChunk = 4;  // frames at a time

// One thread at a time. Calls wait for the GPU, also those that fail: the next one may free memory
// that copies use. The memory is that of the samples of a background or of kMotionChunk frames,
// whichever is more: 35 MiB on the GPU for images of 640x360 pixels.
class MotionLane {
 public:
  explicit MotionLane(int gpu) : gpu_(gpu) {}
  // As MotionFinder's.
  Result<geometry::MedianBackground> find_background(const geometry::MedianSamples& samples);
  Status find_motion(const geometry::MotionSequence& sequence);
  Result<std::vector<std::int16_t>> find_flow(const geometry::FlowPair& pair);

 private:
  // The arrays of a chunk.
  struct Chunk {
    std::uint8_t* rgb;  // in slots
    FlowPyramid pyramid;
    FlowScratch scratch;
    CheckedFlow flow;
    DeviceBackground background;
    MotionMasks masks;
    std::uint8_t* moving;
    std::int16_t* packed;
  };
  class Layout;

  Status start();
  Status upload(const geometry::FillImage& fill, int i, std::size_t bytes, std::uint8_t* to);
  Status download(const void* from, std::size_t bytes, void* to);
  Status clear(void* memory, int byte, std::size_t bytes);
  Status wait();
  static Chunk lay_out(Layout& layout, MotionSize size, int frames);
  Status allocate(MotionSize size, int frames);
  Status start_background(const geometry::MotionSequence& sequence);
  Status load_images(const geometry::MotionSequence& sequence, int first, int last);
  Status start_flow(const geometry::MotionSequence& sequence, int first);
  Status start_chunk(const geometry::MotionSequence& sequence, int first);
  Status hand_over(const geometry::MotionSequence& sequence, int first);
  std::size_t packed_values() const;

  const int gpu_;
  Stream stream_;
  Event done_;
  // Images that are uploaded.
  static constexpr int kStages = 4;
  PinnedArray<std::uint8_t> stages_[kStages];
  Event uploaded_[kStages];
  int stage_ = 0;
  DeviceArray<std::uint8_t> memory_;
  PinnedArray<std::uint8_t> masks_;
  PinnedArray<std::int16_t> packed_;
  PinnedArray<std::uint32_t> counts_;
  std::vector<float> given_flow_;
  MotionSize size_{0, 0};
  Chunk chunk_{};
  int loaded_ = 0;  // images of the sequence
};

}  // namespace stgs::encoder::cuda
