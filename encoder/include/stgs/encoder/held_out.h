// SPDX-License-Identifier: Apache-2.0
// A few held-out pictures, measured while a scene trains. Nothing here changes the training.
#pragma once

#include <cstddef>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/lang.h"

namespace stgs::encoder {

inline constexpr int kMaxHeldOutImages = 8;  // at most, so that a measure stays short

struct SampledView {
  std::size_t camera = 0;  // index into the capture's cameras
  int frame = 0;
};

// At most `most` pictures of the test cameras (or of the training cameras), spread over cameras and
// time alike; each at most once, the same for the same capture.
std::vector<SampledView> sample_views(const PreparedCapture& capture, bool test, int most);

// Means over the pictures, dB; the measures are those of metrics.h.
struct HeldOutScore {
  double psnr = 0, psnr_cc = 0;
  int images = 0;
};

class HeldOutViews {
 public:
  // Decodes the pictures and keeps them, 3 bytes a pixel.
  static Result<HeldOutViews> load(const PreparedCapture& capture);

  bool empty() const { return views_.empty(); }
  // Draws the set before `background` (sRGB-encoded), clamps to [0,1] and compares. Uses all
  // threads; the result does not depend on their number. Throws std::length_error as bin() does.
  HeldOutScore measure(const Gaussians4D& set, math::Vec3 background) const;

 private:
  struct View {
    math::PinholeCamera camera;
    float ticks = 0;
    Image8 truth;
  };
  std::vector<View> views_;
};

}  // namespace stgs::encoder
