// SPDX-License-Identifier: Apache-2.0
// Finds cameras by the names that tools and people give them.
//
// Two names denote the same camera if their letters and numbers are equal, or those of one contain
// those of the other in sequence. Case, separators and leading zeros are ignored: "cam01", "Cam_1"
// and "int_cam01_img" match, but "cam1" and "cam10" do not.
#pragma once

#include <string>
#include <vector>

#include "source_capture.h"

namespace stgs::encoder {

class CameraNames {
 public:
  explicit CameraNames(const std::vector<SourceCamera>& cameras);

  // Returns whether a name denotes one of the cameras. False for more than 255 bytes.
  bool any(const std::string& name) const;
  // Returns the index of the camera that a name denotes, preferring an equal name, or the number of
  // cameras if there is none. kInvalidFile if several match, or for a name of more than 255 bytes.
  // `path`: the calibration, for the message.
  Result<std::size_t> find(const std::string& name, const std::string& path) const;

 private:
  std::vector<std::string> names_;
  std::vector<std::string> words_;  // of the names: their letters and numbers
};

}  // namespace stgs::encoder
