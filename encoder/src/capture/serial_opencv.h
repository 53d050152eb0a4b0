// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <mutex>
#include <opencv2/core/utility.hpp>

namespace stgs::encoder {

// Makes OpenCV single-threaded in the whole process while any such object exists: our loops around
// its calls use all threads. Thread-safe.
class SerialOpenCv {
 public:
  SerialOpenCv() {
    const std::lock_guard lock(mutex_);
    if (objects_++ == 0) before_ = cv::getNumThreads();
    cv::setNumThreads(1);
  }
  ~SerialOpenCv() {
    const std::lock_guard lock(mutex_);
    if (--objects_ == 0) cv::setNumThreads(before_);
  }
  SerialOpenCv(const SerialOpenCv&) = delete;
  SerialOpenCv& operator=(const SerialOpenCv&) = delete;

 private:
  static inline std::mutex mutex_;
  static inline int objects_ = 0, before_ = 0;
};

}  // namespace stgs::encoder
