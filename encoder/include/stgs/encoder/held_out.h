// SPDX-License-Identifier: Apache-2.0
// Evaluates a few held-out images while a scene trains. Nothing here changes the training.
#pragma once

#include <cstddef>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/lang.h"

namespace stgs::encoder {

inline constexpr int kMaxHeldOutImages = 8;  // keeps an evaluation short

struct SampledView {
  std::size_t camera = 0;  // index into the capture's cameras
  int frame = 0;
};

// Selects at most `max_views` images of the test cameras (or, if `test` is false, of the training
// cameras), spread evenly over cameras and time, without those that lack a mask for
// capture.mask_background. No image is selected twice. The selection depends on the capture alone.
std::vector<SampledView> sample_views(const PreparedCapture& capture, bool test, int max_views);

// Means over the images, dB; metrics.h defines the measures.
struct HeldOutScore {
  double psnr = 0, psnr_cc = 0;
  int images = 0;
};

class HeldOutViews {
 public:
  // Decodes sample_views() and keeps them in memory, 3 bytes per pixel.
  static Result<HeldOutViews> load(const PreparedCapture& capture, bool test = true,
                                   int max_views = kMaxHeldOutImages);

  bool empty() const { return views_.empty(); }
  // Renders the set over `background` (sRGB-encoded), clamps to [0,1] and compares with the ground
  // truth. Uses all threads; the result does not depend on their number. Throws std::length_error
  // under the same conditions as bin().
  HeldOutScore evaluate(const Gaussians4D& set, math::Vec3 background, int kernel) const;

 private:
  struct View {
    math::PinholeCamera camera;
    float ticks = 0;
    Image8 ground_truth;
  };
  std::vector<View> views_;
};

}  // namespace stgs::encoder
