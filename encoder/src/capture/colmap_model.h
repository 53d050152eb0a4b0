// SPDX-License-Identifier: Apache-2.0
// Reads a COLMAP model: cameras, images and points3D, as text or binary.
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "source_capture.h"

namespace stgs::encoder {

struct ColmapCamera {
  std::string model;                    // SIMPLE_PINHOLE, PINHOLE, ...
  std::uint64_t width = 0, height = 0;  // pixels
  std::vector<double> params;           // in COLMAP's order for the model
};

struct ColmapImage {
  std::string name;
  std::uint32_t camera = 0;           // key of ColmapModel::cameras
  std::array<double, 4> rotation;     // quaternion w x y z, world to camera
  std::array<double, 3> translation;  // world to camera, scene units
};

struct ColmapModel {
  std::map<std::uint32_t, ColmapCamera> cameras;
  std::vector<ColmapImage> images;  // in natural order of the names
  std::vector<InitialPoint> points;
};

// Returns true if the folder has the cameras and images files of a model.
bool is_colmap_model(const CaptureFolder& files, const std::string& folder);

// Reads the model in `folder`. Binary files take precedence over text files. Every stated count is
// checked against the remaining bytes.
Result<ColmapModel> read_colmap_model(const CaptureFolder& files, const std::string& folder);

// Adds the cameras of the model to `capture`, without frames: one for each folder of images, and
// one for each image outside a folder. If `first_images` is not null, entry i becomes the image
// that camera i was created from. kUnsupported for a moving camera or an unsupported camera model.
// `where` starts the messages.
Status cameras_from_colmap(const ColmapModel& model, const std::string& where,
                           SourceCapture& capture, std::vector<std::string>* first_images);

}  // namespace stgs::encoder
