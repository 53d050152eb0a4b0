// SPDX-License-Identifier: Apache-2.0
// Replaces calibration_toml.cpp and calibration_qualisys.cpp in builds without toml++ and pugixml.
#include "calibration.h"

namespace stgs::encoder {

Result<Calibration> read_toml_calibration(const CaptureFolder&, const std::string& path) {
  return not_built(
      "{}: this build cannot read TOML calibrations; rebuild with toml++, pugixml and "
      "STGS_WITH_CALIBRATION=ON, or give the cameras in cameras.json",
      path);
}

Result<Calibration> read_qualisys(const CaptureFolder&, const std::string& path, const LogSink&) {
  return not_built(
      "{}: this build cannot read Qualisys calibrations; rebuild with toml++, pugixml and "
      "STGS_WITH_CALIBRATION=ON, or give the cameras in cameras.json",
      path);
}

}  // namespace stgs::encoder
