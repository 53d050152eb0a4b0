// SPDX-License-Identifier: Apache-2.0
// Reads calibrations in OpenCV's FileStorage: YAML, JSON or XML.
#pragma once

#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "source_capture.h"

namespace stgs::encoder {

// The keys of a file. Of repeated keys, the first counts; lists at the root are skipped.
class Storage {
 public:
  // kInvalidFile if OpenCV cannot parse it.
  static Result<Storage> open(const CaptureFolder& files, const std::string& path);

  const std::string& path() const { return path_; }
  // Returns the value of a key, or an empty node. cv::FileStorage would visit all keys.
  cv::FileNode operator[](const std::string& key) const;
  // Returns the numbers of the first key that exists, row by row, or an empty list if none exists.
  // The value is a number, a matrix (opencv-matrix), or a nested list. The error names the file.
  Result<std::vector<double>> numbers(const std::vector<std::string>& keys) const;

 private:
  Storage(cv::FileStorage file, std::string path);

  std::string path_;
  cv::FileStorage file_;
  std::map<std::string, cv::FileNode> nodes_;  // of file_
};

// Sets the pose of `camera` from a rotation vector (3 numbers) or a row-major matrix (9), and a
// translation of 3 numbers; world to camera. kInvalidFile for other counts.
Status set_opencv_pose(const std::vector<double>& rotation, const std::vector<double>& translation,
                       const std::string& where, SourceCamera& camera);

}  // namespace stgs::encoder
