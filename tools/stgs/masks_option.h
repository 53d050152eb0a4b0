// SPDX-License-Identifier: Apache-2.0
// The options --masks, which measures errors within any masks, and --foreground, which cuts frames
// out by the masks of the capture.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "arguments.h"
#include "moving.h"
#include "session.h"
#include "stgs/encoder/image_file.h"
#include "stgs/encoder/metrics.h"
#include "stgs/encoder/prepared_capture.h"

namespace stgs::tools {

class MasksOption {
 public:
  void declare(Arguments& app) {
    app.add_option(
        "--masks", folder_,
        "Also measure within masks: images FOLDER/CAMERA/NNNNNN.png, named as the frames "
        "of the capture, 128 or more inside");
    app.add_flag(
        "--foreground", foreground_,
        "Compare with the content inside the masks of the capture, over the background of the "
        "scene");
  }
  bool given() const { return !folder_.empty(); }
  bool foreground() const { return foreground_; }
  // With --foreground, sets the background of the scene outside the masks of the capture.
  void apply(const SceneMetadata& scene, encoder::PreparedCapture& capture) const {
    if (!foreground_) return;
    std::array<std::uint8_t, 3> colour{};
    for (int c = 0; c < 3; ++c) {
      const float value = std::clamp(scene.background[c], 0.0f, 1.0f);
      colour[c] = static_cast<std::uint8_t>(std::lround(255 * value));
    }
    capture.mask_background = colour;
  }

  // Adds the errors within the masks, summed over frames, if there are masks.
  void add(const ErrorSum& masked, Json& json) const {
    if (!given()) return;
    json["psnr_masked"] = masked.pixels > 0 ? Json(encoder::psnr_of(masked.mean())) : Json(nullptr);
    json["masked_pixels"] = masked.pixels;
  }
  std::string text(const ErrorSum& masked) const {
    std::string out = foreground_ ? ", of the foreground" : "";
    if (!given()) return out;
    if (masked.pixels == 0) return out + ", the masks are empty";
    return out + fmt::format(", within the masks {:.3f} dB", encoder::psnr_of(masked.mean()));
  }

  // Returns the error within the mask of a frame. kIo for a missing mask, kInvalidFile for one of
  // another size.
  Result<ErrorSum> error(const std::string& camera, int frame, const Image& image,
                         const encoder::Image8& ground_truth) const {
    const std::string path = fmt::format("{}/{}/{:06}.png", folder_, camera, frame);
    STGS_ASSIGN(const encoder::Image8 mask, encoder::read_image8(path, 1));
    if (mask.width != ground_truth.width || mask.height != ground_truth.height) {
      return invalid_file(
          "{}: the mask has another size than the frame (expected {}x{}, got {}x{}); scale it",
          path, ground_truth.width, ground_truth.height, mask.width, mask.height);
    }
    ErrorSum sum;
    for (std::size_t i = 0; i < mask.data.size(); ++i) {
      if (mask.data[i] >= encoder::kMinMask) sum.add(image, ground_truth, i);
    }
    return sum;
  }

 private:
  std::string folder_;
  bool foreground_ = false;
};

}  // namespace stgs::tools
