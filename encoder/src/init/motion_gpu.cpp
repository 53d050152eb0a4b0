// SPDX-License-Identifier: Apache-2.0
#include "init/motion_gpu.h"

#include <cstring>

namespace stgs::encoder::init {
namespace {

// Writes the mask of a frame; nothing is masked without one.
Status load_mask_to(const PreparedCapture& capture, const View& view, int frame,
                    std::uint8_t* out) {
  STGS_ASSIGN(const cv::Mat mask, load_mask_image(capture, view, frame));
  const std::size_t pixels = static_cast<std::size_t>(view.size().area());
  if (mask.empty())
    std::memset(out, 0, pixels);
  else
    std::memcpy(out, mask.data, pixels);
  return {};
}

// Returns the part around a mask of flow as FrameMotion::flow.
FlowPatch patch_of(const std::int16_t* flow, const cv::Mat& mask) {
  FlowPatch patch;
  patch.step = kFlowStep;
  if (flow == nullptr) return patch;
  patch.box = packed_box(mask);
  const cv::Size size((mask.cols + 1) / kFlowStep, (mask.rows + 1) / kFlowStep);
  patch.vectors = cv::Mat(size, CV_16SC2, const_cast<std::int16_t*>(flow))(patch.box).clone();
  return patch;
}

// `background` must outlive the sequence.
geometry::MotionSequence sequence_of(const View& view, int frames, const Background& background) {
  geometry::MotionSequence sequence;
  sequence.width = view.width;
  sequence.height = view.height;
  sequence.frames = frames;
  sequence.background = background.colour.data;
  sequence.noise = background.noise;
  return sequence;
}

}  // namespace

Result<Background> find_gpu_background(geometry::MotionFinder& gpu, const PreparedCapture& capture,
                                       const View& view, bool use_masks) {
  const std::vector<int> frames = background_frames(capture, view);
  if (frames.empty()) return unknown_background(view);
  geometry::MedianSamples samples;
  samples.width = view.width;
  samples.height = view.height;
  samples.count = int(frames.size());
  samples.image = [&](int i, std::uint8_t* rgb) {
    return load_image_to(capture, view, frames[i], rgb);
  };
  if (use_masks) {
    samples.mask = [&](int i, std::uint8_t* mask) {
      return load_mask_to(capture, view, frames[i], mask);
    };
  }
  STGS_ASSIGN(geometry::MedianBackground found, gpu.find_background(samples));
  return Background{cv::Mat(view.size(), CV_8UC3, found.colour.data()).clone(),
                    cv::Mat(view.size(), CV_8U, found.valid.data()).clone(), found.noise};
}

Status write_gpu_masks(geometry::MotionFinder& gpu, const PreparedCapture& capture,
                       const View& view, const InitSettings& settings, const Background& background,
                       const Work& work, ViewMotion* motion) {
  geometry::MotionSequence sequence = sequence_of(view, capture.frames, background);
  sequence.image = [&](int frame, std::uint8_t* rgb) -> Status {
    STGS_TRY(work.check());
    return load_image_to(capture, view, frame, rgb);
  };
  cv::Mat given;
  if (capture.frames > 1) {  // the last frame has no flow
    STGS_ASSIGN(given, given_flow(capture, view, settings, 0));
  }
  if (!given.empty()) {
    sequence.flow = [&](int frame, float* flow) -> Status {
      STGS_ASSIGN(const cv::Mat found, given_flow(capture, view, settings, frame));
      std::memcpy(flow, found.data, found.total() * found.elemSize());
      return {};
    };
  }
  sequence.take = [&](const geometry::FrameMotion& found) -> Status {
    const cv::Mat mask(view.size(), CV_8U, const_cast<std::uint8_t*>(found.mask));
    STGS_TRY(add_mask(capture, view, found.frame, mask));
    motion->coverage[found.frame] = float(found.masked) / float(mask.total());
    motion->flow[found.frame] = patch_of(found.flow, mask);
    motion->has_flow[found.frame] = 1;
    return {};
  };
  return gpu.find_motion(sequence);
}

Status find_gpu_masks(geometry::MotionFinder& gpu, const PreparedCapture& capture, const View& view,
                      const Background& background, const std::vector<int>& frames,
                      const Work& work, const MaskSink& take) {
  if (frames.empty()) return {};
  geometry::MotionSequence sequence = sequence_of(view, int(frames.size()), background);
  sequence.use_flow = false;
  sequence.image = [&](int i, std::uint8_t* rgb) -> Status {
    STGS_TRY(work.check());
    return load_image_to(capture, view, frames[i], rgb);
  };
  sequence.take = [&](const geometry::FrameMotion& found) {
    return take(frames[found.frame],
                cv::Mat(view.size(), CV_8U, const_cast<std::uint8_t*>(found.mask)));
  };
  return gpu.find_motion(sequence);
}

Status find_gpu_flow(geometry::MotionFinder& gpu, const PreparedCapture& capture, const View& view,
                     int frame, ViewMotion* motion) {
  geometry::FlowPair pair;
  pair.width = view.width;
  pair.height = view.height;
  pair.image = [&](int i, std::uint8_t* rgb) {
    return load_image_to(capture, view, frame + i, rgb);
  };
  cv::Mat mask(view.size(), CV_8U);
  pair.mask = [&](int, std::uint8_t* out) -> Status {
    STGS_TRY(load_mask_to(capture, view, frame, out));
    std::memcpy(mask.data, out, mask.total());
    return {};
  };
  STGS_ASSIGN(const std::vector<std::int16_t> flow, gpu.find_flow(pair));
  motion->flow[frame] = patch_of(flow.data(), mask);
  motion->has_flow[frame] = 1;
  return {};
}

}  // namespace stgs::encoder::init
