// SPDX-License-Identifier: Apache-2.0
// The option --masks: errors within masks of the content that matters.
#pragma once

#include <string>

#include "arguments.h"
#include "moving.h"
#include "stgs/encoder/image_file.h"

namespace stgs::tools {

class MasksOption {
 public:
  void declare(Arguments& app) {
    app.add_option(
        "--masks", folder_,
        "Also measure within masks: images FOLDER/CAMERA/NNNNNN.png, named as the frames "
        "of the capture, 128 or more inside");
  }
  bool given() const { return !folder_.empty(); }

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
      if (mask.data[i] >= 128) sum.add(image, ground_truth, i);
    }
    return sum;
  }

 private:
  std::string folder_;
};

}  // namespace stgs::tools
