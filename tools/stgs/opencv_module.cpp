// SPDX-License-Identifier: Apache-2.0
#include "opencv_module.h"

#include <opencv2/core/utils/logger.hpp>

#include "mp4.h"
#include "stgs/format/temporary.h"
#include "stgs/format/thread_pool.h"

namespace stgs::tools {
namespace {

void set_up(int threads, bool quiet) {
  if (threads > 0) default_thread_pool().set_threads(threads);
  if (quiet) cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
}

}  // namespace
}  // namespace stgs::tools

extern "C" __attribute__((visibility("default"))) const stgs::tools::OpenCvFunctions*
STGS_OPENCV_SYMBOL() {
  using namespace stgs::tools;
  static const OpenCvFunctions functions = {.set_up = set_up,
                                            .remove_unfinished = stgs::remove_unfinished,
                                            .prepare = stgs::encoder::prepare,
                                            .open_windows = stgs::encoder::WindowPreparer::open,
                                            .open_live = stgs::encoder::LivePreparer::open,
                                            .make_mp4_writer = open_mp4_writer};
  return &functions;
}
