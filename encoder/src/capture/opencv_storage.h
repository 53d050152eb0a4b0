// SPDX-License-Identifier: Apache-2.0
// Reads calibrations in OpenCV's FileStorage: YAML, JSON or XML.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "source_capture.h"

namespace stgs::encoder {

// Opens a file for reading. kInvalidFile if OpenCV cannot parse it.
Result<cv::FileStorage> open_storage(const CaptureFolder& files, const std::string& path);

// Returns the numbers of the first key that exists, row by row, or an empty list if none exists.
// The value is a number, a matrix (opencv-matrix), or a nested list. The error names the file.
Result<std::vector<double>> storage_numbers(const cv::FileStorage& file,
                                            const std::vector<std::string>& keys,
                                            const std::string& path);

// Sets the pose of `camera` from a rotation vector (3 numbers) or a row-major matrix (9), and a
// translation of 3 numbers; world to camera. kInvalidFile for other counts.
Status set_opencv_pose(const std::vector<double>& rotation, const std::vector<double>& translation,
                       const std::string& where, SourceCamera& camera);

}  // namespace stgs::encoder
