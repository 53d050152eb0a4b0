// SPDX-License-Identifier: Apache-2.0
// Where images differ from renderings of the persistent set, and initial points of static content
// there.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "train/set_views.h"

namespace stgs::encoder {

// By how much a rendering of a view differs from its image, beyond what is usual.
struct ViewChange {
  std::vector<float> excess;  // per pixel; empty without an image
  float limit = 0;            // above which a pixel has changed

  bool known() const { return !excess.empty(); }
  bool has_changed(std::size_t pixel) const { return excess[pixel] > limit; }
};

// The usual difference of a rendering from the images of a view, per pixel, in units of 1/255. The
// set shows some content better than other.
using Residual = std::vector<std::uint8_t>;

// Lowers residuals to the differences of renderings from these images.
void update_residuals(const std::vector<SetView>& shown, const std::vector<Image>& images,
                      std::vector<Residual>& residuals);

// Compares renderings with the images of the same views. The limits follow from most pixels, for
// instance after a change of the light.
std::vector<ViewChange> find_view_changes(const std::vector<SetView>& shown,
                                          const std::vector<Image>& images,
                                          const std::vector<Residual>& residuals);

// Finds points of content that has changed, and is static from frame `first` to frame
// `last`, of which `images` are. At most `limit`.
Result<std::vector<InitialPoint>> find_changed_points(const SetViews& views,
                                                      const std::vector<SetView>& shown,
                                                      const std::vector<Image>& images,
                                                      const std::vector<ViewChange>& changes,
                                                      int first, int last, std::size_t limit);

}  // namespace stgs::encoder
