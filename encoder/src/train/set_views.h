// SPDX-License-Identifier: Apache-2.0
// Views of the training cameras at a reduced size: their images in a window, and renderings of a
// set to compare them with.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/raster.h"
#include "train/train_state.h"

namespace stgs::encoder {

// A rendering of a set.
struct SetView {
  Image colour;        // sRGB-encoded, blurred
  Image depth, alpha;  // see RasterOutput
};

class SetViews {
 public:
  // Views of the training cameras as the state has refined them, with its colour correction.
  // `capture` must outlive the object.
  SetViews(const PreparedCapture& capture, const TrainState& state, int kernel);

  std::size_t size() const { return cameras_.size(); }
  const math::PinholeCamera& camera(std::size_t view) const { return cameras_[view]; }
  // Returns the images of all views in a frame, blurred; empty where a camera has no frame. The
  // error is that of reading a frame.
  Result<std::vector<Image>> images(int frame) const;
  // Renders a static set.
  std::vector<SetView> render(const Gaussians4D& set) const;

 private:
  Result<Image> image(std::size_t view, int frame) const;

  const PreparedCapture& capture_;
  const TrainState& state_;
  int kernel_;
  std::vector<Camera> full_;
  std::vector<int> factors_;                  // by which the images are smaller than the cameras'
  std::vector<math::PinholeCamera> cameras_;  // of the reduced images
};

// Returns the index of the pixel that a position in camera space projects to; -1 outside the image
// or in front of the near plane.
std::ptrdiff_t pixel_of(const math::PinholeCamera& camera, const math::Vec3& position);

// Returns the position in the world of an image position, pixels, at a depth.
math::Vec3 to_world(const math::PinholeCamera& camera, float u, float v, float depth);

}  // namespace stgs::encoder
