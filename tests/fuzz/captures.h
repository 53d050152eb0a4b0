// SPDX-License-Identifier: Apache-2.0
// Properties of every camera and path that is read, for the targets of captures.
#pragma once

#include <cmath>
#include <set>
#include <string>

#include "capture/source_capture.h"
#include "packed_files.h"
#include "stgs/encoder/capture_folder.h"
#include "stgs/format/text.h"

namespace stgs::fuzz {

// Aborts if an error has no message, or if its message is not text.
inline void check_error(const Status& status) {
  if (status.ok()) return;
  require(!status.message().empty(), "an error has a message");
  require(status.code() != StatusCode::kRuntime && status.code() != StatusCode::kNoMemory,
          "damaged input is not reported as a failure of the program");
}

// Aborts if opening a path of the capture opens a file outside the folder.
inline void check_path(const encoder::CaptureFolder& files, const std::string& path) {
  const std::string inside = files.path() + "/";
  require(path.compare(0, inside.size(), inside) == 0, "a path begins with the folder");
  const auto file = files.open_file(path);
  if (!file.ok()) return;
  const std::string opened = path_of_descriptor(file->descriptor());
  require(opened.compare(0, inside.size(), inside) == 0, "an opened file is in the folder");
}

// Aborts if the intrinsics, the lens or the pose of a camera are not numbers of a camera.
inline void check_source_camera(const encoder::SourceCamera& camera) {
  require(camera.fx > 0 && camera.fy > 0, "focal lengths are positive");
  require(camera.width >= 0 && camera.height >= 0, "the size is not negative");
  for (const double v : camera.distortion) require(!std::isnan(v), "the lens has numbers");
  const std::size_t lens = camera.distortion.size();
  require(lens == 0 || lens == 4 || lens == 5 || lens == 8, "the lens model has its coefficients");
}

}  // namespace stgs::fuzz
