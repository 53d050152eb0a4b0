// SPDX-License-Identifier: Apache-2.0
// Reads calibrations of other tools that lie next to uncalibrated videos or image folders.
//
// All of them describe lenses by OpenCV's coefficients and put the centre of the first pixel at 0,
// so the principal point gains 0.5. They are looked for in the capture folder, videos/, images/ and
// calibration/, in this order of precedence:
//
//   *.qca.txt, *.qca.xml, *calib*.xml   Qualisys Track Manager
//   *calib*.toml                        Pose2Sim, Anipose
//   CAMERA.yml, .yaml, .json, .xml      OpenCV FileStorage, one file per camera
#pragma once

#include <string>
#include <vector>

#include "source_capture.h"

namespace stgs::encoder {

struct Calibration {
  std::vector<SourceCamera> cameras;  // without frames
  bool metric = false;                // scene units are metres
};

struct CalibrationSearch {
  std::string path;  // of the calibration that was read, or the folder of the files; empty: none
  Calibration calibration;           // its cameras have the names and frames of the given ones
  std::vector<std::string> ignored;  // files that look like a calibration but were not read
};

// Searches the capture for the calibration of `cameras` and matches it to them by name. Logs
// ignored files and cameras. kInvalidFile if a calibration is damaged, if there are several of one
// kind, or if it does not fit the cameras; kNotBuilt if this build cannot read it.
Result<CalibrationSearch> find_calibration(const CaptureFolder& files,
                                           const std::vector<SourceCamera>& cameras,
                                           const LogSink& log);

// Readers of one file. They set names, intrinsics, lenses and poses.
Result<Calibration> read_qualisys(const CaptureFolder& files, const std::string& path,
                                  const LogSink& log);
Result<Calibration> read_toml_calibration(const CaptureFolder& files, const std::string& path);
// Returns no camera if the file has no camera matrix or no pose.
Result<Calibration> read_opencv_camera(const CaptureFolder& files, const std::string& path,
                                       const std::string& name);

}  // namespace stgs::encoder
