// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/held_out.h"

#include <algorithm>

#include "stgs/encoder/metrics.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster.h"

namespace stgs::encoder {

namespace {

constexpr std::size_t kPixelsAtOnce = 1 << 23;  // rendering takes about 40 bytes per pixel

// Returns whether a frame has the mask that the foreground needs.
bool can_show(const PreparedCapture& capture, const Camera& camera, int frame) {
  return !capture.mask_background || has_mask(capture, camera, frame);
}

}  // namespace

std::vector<SampledView> sample_views(const PreparedCapture& capture, bool test, int max_views) {
  std::vector<std::size_t> cameras;
  for (std::size_t i = 0; i < capture.cameras.size(); ++i) {
    const Camera& camera = capture.cameras[i];
    if (camera.test == test && can_show(capture, camera, 0)) cameras.push_back(i);
  }
  const auto frames = static_cast<std::size_t>(std::max(capture.frames, 0));
  const std::size_t count =
      std::min(static_cast<std::size_t>(std::max(max_views, 0)), cameras.size() * frames);
  std::vector<SampledView> views;
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t camera =
        cameras.size() <= count ? k % cameras.size() : k * cameras.size() / count;
    const std::size_t frame = (2 * k + 1) * frames / (2 * count);
    if (can_show(capture, capture.cameras[cameras[camera]], static_cast<int>(frame)))
      views.push_back({cameras[camera], static_cast<int>(frame)});
  }
  return views;
}

Result<HeldOutViews> HeldOutViews::load(const PreparedCapture& capture, bool test, int max_views) {
  HeldOutViews held_out;
  for (const SampledView& sampled : sample_views(capture, test, max_views)) {
    const Camera& camera = capture.cameras[sampled.camera];
    View view;
    view.camera = camera.pinhole(capture.near_plane);
    view.ticks = static_cast<float>(capture.time_of(camera, sampled.frame));
    STGS_ASSIGN(view.ground_truth, load_frame(capture, camera, sampled.frame));
    held_out.views_.push_back(std::move(view));
  }
  return held_out;
}

HeldOutScore HeldOutViews::evaluate(const Gaussians4D& set, math::Vec3 background,
                                    int kernel) const {
  RasterSettings settings;
  settings.background = background;
  settings.kernel = kernel;
  std::vector<HeldOutScore> scores(views_.size());
  const auto score = [&](std::size_t i) {
    const View& view = views_[i];
    SplatFrame frame;
    RasterOutput output;
    render(set, view.ticks, view.camera, settings, frame, output);
    // Non-finite values count as black.
    for (float& v : output.colour.data) v = v > 0.0f ? std::min(v, 1.0f) : 0.0f;
    const Image ground_truth = to_float(view.ground_truth);
    scores[i].psnr = psnr_of(mean_squared_error(output.colour, ground_truth));
    scores[i].psnr_cc = psnr_of(colour_corrected_error(output.colour, ground_truth));
  };
  std::size_t largest = 1;
  for (const View& view : views_) largest = std::max(largest, view.ground_truth.data.size() / 3);
  const std::size_t at_once = std::max<std::size_t>(1, kPixelsAtOnce / largest);
  for (std::size_t i = 0; i < views_.size(); i += at_once)
    parallel_for(i, std::min(i + at_once, views_.size()), score);
  HeldOutScore mean;
  mean.images = static_cast<int>(views_.size());
  for (const HeldOutScore& one : scores) {
    mean.psnr += one.psnr / mean.images;
    mean.psnr_cc += one.psnr_cc / mean.images;
  }
  return mean;
}

}  // namespace stgs::encoder
