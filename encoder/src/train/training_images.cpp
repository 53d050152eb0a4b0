// SPDX-License-Identifier: Apache-2.0
#include "train/training_images.h"

#include <algorithm>

#include "half_size.h"
#include "stgs/format/parallel.h"
#include "train/foreground.h"
#include "train/machine_memory.h"

namespace stgs::encoder {
namespace {

constexpr int kMinSide = 16;  // pixels, so that the half size is not degenerate
// Fraction of the available memory for decoded images; the rest is for training and other
// processes.
constexpr double kMemoryFraction = 0.6;

}  // namespace

Result<TrainingImages> TrainingImages::load(const PreparedCapture& capture, std::uint64_t budget,
                                            int processes, const ProgressSink& progress) {
  TrainingImages images;
  images.frames_ = capture.frames;
  images.cameras_ = capture.training_cameras();
  if (images.cameras_.empty()) {
    return usage_error(
        "{}: every camera is held out for testing; prepare it with at least one training camera",
        capture.folder);
  }
  for (const Camera& camera : images.cameras_) {
    if (std::min(camera.width, camera.height) >= kMinSide) continue;
    return unsupported(
        "{}: the frames of camera '{}' are too small (expected at least {} pixels per side, got "
        "{}x{})",
        capture.folder, camera.name, kMinSide, camera.width, camera.height);
  }
  images.list_views(capture);
  if (images.views_.empty())
    return runtime_error("{}: no camera has delivered a frame", capture.folder);
  FrameStore::Source source;
  for (std::size_t i = 0; i < images.views(); ++i) {
    const Camera& camera = images.cameras_[images.view(i).camera];
    source.views.push_back({camera.width, camera.height});
  }
  source.decode = [capture, cameras = images.cameras_,
                   views = images.views_](std::size_t index) -> Result<FrameStore::ImagePtr> {
    const auto frames = static_cast<std::size_t>(capture.frames);
    const std::size_t view = views[index];
    const Camera& camera = cameras[view / frames];
    const auto frame = static_cast<int>(view % frames);
    if (!capture.mask_background) return load_shared_frame(capture, camera, frame);
    STGS_ASSIGN(Image8 image, load_foreground(capture, camera, frame, mask_colour_of(view)));
    return std::make_shared<const Image8>(std::move(image));
  };
  if (budget == 0) {
    budget = static_cast<std::uint64_t>(kMemoryFraction / processes *
                                        static_cast<double>(available_memory()));
  }
  images.store_ = std::make_unique<FrameStore>(std::move(source), budget, concurrency());
  const auto views = static_cast<double>(images.views());
  STGS_TRY(images.store_->start([&](std::size_t loaded) {
    if (!progress || loaded == images.views()) return true;
    const std::string detail = fmt::format("{} of {} frames", loaded, images.views());
    return progress({"load", static_cast<double>(loaded) / views, -1, detail});
  }));
  if (progress && !progress({"load", 1.0, 0.0, fmt::format("{} frames", images.views())})) {
    return runtime_error("stopped before the first step");
  }
  return images;
}

void TrainingImages::list_views(const PreparedCapture& capture) {
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    for (int frame = 0; frame < frames_; ++frame) {
      index_.push_back(static_cast<std::uint32_t>(views_.size()));
      if (!has_frame(capture, cameras_[c], frame)) continue;
      views_.push_back(static_cast<std::uint32_t>(c) * static_cast<std::uint32_t>(frames_) +
                       static_cast<std::uint32_t>(frame));
    }
  }
}

std::uint64_t TrainingImages::id_of(const TrainingView& view) const {
  const std::size_t view_index = view.camera * static_cast<std::size_t>(frames_) + view.frame;
  return FrameStore::id_of(index_[view_index], view.level);
}

Result<TrainingImage> TrainingImages::next(
    const std::function<TrainingView(std::uint64_t k)>& upcoming) {
  const std::uint64_t id = id_of(upcoming(0));
  // Announces two epochs at a time, so that at least one is always known.
  if (store_->announced() < views() || store_->next() != id) {
    std::vector<std::uint64_t> ids(2 * views());
    for (std::size_t k = 0; k < ids.size(); ++k) ids[k] = id_of(upcoming(k));
    store_->announce(std::move(ids));
  }
  return store_->acquire(id);
}

math::PinholeCamera TrainingImages::pinhole(std::size_t camera, int level, float near_plane) const {
  const Camera& full = cameras_[camera];
  return (level == 1 ? half_size(full) : full).pinhole(near_plane);
}

}  // namespace stgs::encoder
