// SPDX-License-Identifier: Apache-2.0
// A COLMAP model: cameras, images and points3D, as text or binary.
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "source_capture.h"

namespace stgs::encoder {

struct ColmapCamera {
  std::string model;  // SIMPLE_PINHOLE, PINHOLE, ...
  std::uint64_t width = 0, height = 0;
  std::vector<double> params;
};

struct ColmapImage {
  std::string name;
  std::uint32_t camera = 0;
  std::array<double, 4> rotation;  // quaternion w x y z, world to camera
  std::array<double, 3> translation;
};

struct ColmapModel {
  std::map<std::uint32_t, ColmapCamera> cameras;
  std::vector<ColmapImage> images;  // in natural order of their names
  std::vector<InitialPoint> points;
};

bool is_colmap_model(const std::string& folder);

// Binary files are taken where both kinds are there. Every count is checked against the bytes left.
Result<ColmapModel> read_colmap_model(const std::string& folder);

// Adds the model's cameras to `capture`, without frames: one for each folder of images, or image
// without a folder. first_images[i], if asked for, is the image that camera i was taken from.
// Error: a camera that moves, or of an unsupported model. `where` is for messages.
Status cameras_from_colmap(const ColmapModel& model, const std::string& where,
                           SourceCapture& capture, std::vector<std::string>* first_images);

}  // namespace stgs::encoder
