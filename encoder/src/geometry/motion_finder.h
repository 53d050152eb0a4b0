// SPDX-License-Identifier: Apache-2.0
// Detection of dynamic content on a GPU: median backgrounds, flow and motion masks. The reference
// on the CPU is init/background.h and init/motion.h; only the flow differs (geometry/flow_rule.h).
// Images are 8-bit RGB and masks 8-bit, 0 or 255; rows without gaps.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder::geometry {

// Writes image or mask `i` to memory of its size. Called on the thread of the caller.
using FillImage = std::function<Status(int i, std::uint8_t* out)>;

struct MedianSamples {
  int width = 0, height = 0;
  int count = 0;    // 1 to kMaxMedianSamples
  FillImage image;  // of sample i in [0, count)
  FillImage mask;   // pixels that do not count, nor those nearby; null: all count
};

struct MedianBackground {
  std::vector<std::uint8_t> colour, valid;  // `valid`: 255 where a sample counts, else 0
  double noise = 1;                         // standard deviation of a static pixel, grey levels
};

// The findings in a frame. Pointers are valid during the call.
struct FrameMotion {
  int frame = 0;
  const std::uint8_t* mask = nullptr;
  int masked = 0;  // pixels
  // The flow to the next frame at every second pixel of every second row: x and y in units of 1/32
  // pixel, both kUnknownFlow where it is unknown or not masked. Null for the last frame, and if
  // flow is not used.
  const std::int16_t* flow = nullptr;
};

struct MotionSequence {
  int width = 0, height = 0;
  int frames = 0;
  const std::uint8_t* background = nullptr;  // RGB
  double noise = 1;                          // of the background
  bool use_flow = true;                      // false: masks follow from the background alone
  FillImage image;                           // of frame i in [0, frames)
  // Writes the flow of all pixels from frame i to the next, x and y in pixels. Null: it is found.
  std::function<Status(int i, float* flow)> flow;
  std::function<Status(const FrameMotion&)> take;  // called for the frames in order
};

struct FlowPair {
  int width = 0, height = 0;
  FillImage image;  // i = 0, and i = 1 for the next frame
  FillImage mask;   // of the first; i = 0
};

// Thread-safe: several cameras at a time, each with bounded memory that later calls use again. It
// is freed with the finder: 0.5 GiB of a GPU for 16 cameras with images of 640x360 pixels, a
// quarter of that for those of a live capture. Creating another finder takes microseconds. kRuntime
// if the GPU fails, or the status of a callback.
class MotionFinder {
 public:
  virtual ~MotionFinder() = default;
  virtual std::string name() const = 0;
  virtual Result<MedianBackground> find_background(const MedianSamples& samples) = 0;
  virtual Status find_motion(const MotionSequence& sequence) = 0;
  // Returns the flow of a pair, as FrameMotion::flow.
  virtual Result<std::vector<std::int16_t>> find_flow(const FlowPair& pair) = 0;
};

// On GPU number `gpu` modulo the number of GPUs. kNotBuilt without CUDA, kUnsupported without one.
Result<std::unique_ptr<MotionFinder>> make_cuda_motion_finder(int gpu);

}  // namespace stgs::encoder::geometry
