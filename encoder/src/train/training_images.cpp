// SPDX-License-Identifier: Apache-2.0
#include "train/training_images.h"
#include "stgs/format/parallel.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <mutex>

namespace stgs::encoder {
namespace {

constexpr int kSmallestSide = 16;  // pixels; half of it is still a picture

// Mean of 2x2 pixels; an odd last row or column is left out.
Image8 half_size(const Image8& image) {
  Image8 half;
  half.width = image.width / 2;
  half.height = image.height / 2;
  half.channels = image.channels;
  half.data.resize(std::size_t{1} * half.width * half.height * half.channels);
  const std::size_t row = std::size_t{1} * image.width * image.channels;
  for (int y = 0; y < half.height; ++y) {
    for (int x = 0; x < half.width; ++x) {
      for (int c = 0; c < image.channels; ++c) {
        const std::uint8_t* p = &image.data[2 * y * row + (2 * x) * image.channels + c];
        const int sum = p[0] + p[image.channels] + p[row] + p[row + image.channels];
        half.data[(std::size_t{1} * y * half.width + x) * half.channels + c] =
            static_cast<std::uint8_t>((sum + 2) / 4);
      }
    }
  }
  return half;
}

Status check_memory(const std::vector<Camera>& cameras, int frames) {
  double bytes = 0;
  for (const Camera& camera : cameras) bytes += 3.75 * camera.width * camera.height * frames;
  const double memory =
      static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE));
  if (bytes < 0.8 * memory) return {};
  return unsupported(
      "the training frames need {:.1f} GiB of memory and this machine has {:.1f} GiB: prepare "
      "fewer "
      "frames (--frames) or smaller ones (--scale)",
      bytes / (1 << 30), memory / (1 << 30));
}

}  // namespace

Result<TrainingImages> TrainingImages::load(const PreparedCapture& capture,
                                            const ProgressSink& progress) {
  TrainingImages images;
  images.frames_ = capture.frames;
  for (const Camera& camera : capture.cameras) {
    if (!camera.test) images.cameras_.push_back(camera);
  }
  if (images.cameras_.empty()) {
    return usage_error("{}: every camera is held out; leave at least one for training",
                       capture.folder);
  }
  for (const Camera& camera : images.cameras_) {
    if (std::min(camera.width, camera.height) >= kSmallestSide) continue;
    return unsupported("{}: the frames of camera '{}' are {}x{}; training needs {} pixels a side",
                       capture.folder, camera.name, camera.width, camera.height, kSmallestSide);
  }
  STGS_TRY(check_memory(images.cameras_, capture.frames));
  for (auto& level : images.images_) level.resize(images.views());
  std::mutex mutex;
  Status first_error;
  std::atomic<bool> failed = false;
  parallel_for(std::size_t{0}, images.cameras_.size(), [&](std::size_t c) {
    for (int frame = 0; frame < images.frames_; ++frame) {
      if (failed) return;
      Result<Image8> image = load_frame(capture, images.cameras_[c], frame);
      if (!image.ok()) {
        const std::lock_guard lock(mutex);
        if (first_error.ok()) first_error = image.status();
        failed = true;
        return;
      }
      const std::size_t view = c * static_cast<std::size_t>(images.frames_) + frame;
      images.images_[1][view] = half_size(*image);
      images.images_[0][view] = std::move(*image);
    }
  });
  STGS_TRY(first_error);
  if (progress) progress({"load", 1.0, 0.0, fmt::format("{} frames", images.views())});
  return images;
}

math::PinholeCamera TrainingImages::pinhole(std::size_t camera, int level, float near_plane) const {
  math::PinholeCamera pinhole = cameras_[camera].pinhole(near_plane);
  if (level == 1) {
    // Pixel centres are at +0.5, so halving the size halves every intrinsic.
    pinhole.fx *= 0.5f;
    pinhole.fy *= 0.5f;
    pinhole.cx *= 0.5f;
    pinhole.cy *= 0.5f;
    pinhole.width = static_cast<float>(cameras_[camera].width / 2);
    pinhole.height = static_cast<float>(cameras_[camera].height / 2);
  }
  return pinhole;
}

}  // namespace stgs::encoder
