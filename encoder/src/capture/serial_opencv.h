// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/utility.hpp>

namespace stgs::encoder {

// Makes OpenCV single-threaded in the whole process: our loops around its calls use all threads.
class SerialOpenCv {
 public:
  SerialOpenCv() : before_(cv::getNumThreads()) { cv::setNumThreads(1); }
  ~SerialOpenCv() { cv::setNumThreads(before_); }
  SerialOpenCv(const SerialOpenCv&) = delete;
  SerialOpenCv& operator=(const SerialOpenCv&) = delete;

 private:
  const int before_;
};

}  // namespace stgs::encoder
