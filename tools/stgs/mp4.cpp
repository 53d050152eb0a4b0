// SPDX-License-Identifier: Apache-2.0
#include "mp4.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "stgs/format/output_file.h"
#include "stgs/format/output_path.h"

namespace stgs::tools {

namespace {

class Mp4Writer final : public VideoWriter {
 public:
  Mp4Writer(const std::string& path, TimeBase time_base, encoder::LogSink log)
      : path_(path), fps_(1.0 / time_base.seconds(1)), log_(std::move(log)) {}

  Status add(const encoder::Image8& frame) override {
    try {
      if (frames_ == 0) STGS_TRY(open(frame.width, frame.height));
      const cv::Mat rgb(frame.height, frame.width, CV_8UC3,
                        const_cast<std::uint8_t*>(frame.data.data()));
      cv::cvtColor(rgb, bgr_, cv::COLOR_RGB2BGR);
      writer_.write(bgr_);
      ++frames_;
    } catch (const std::exception& error) {
      return runtime_error("{}: cannot encode frame {}: {}", path_, frames_, error.what());
    }
    return {};
  }

  // OpenCV reports no write errors: reopen the file and count its frames.
  Status finish() override {
    try {
      writer_.release();
      cv::VideoCapture check(made_, cv::CAP_FFMPEG);
      const int found =
          check.isOpened() ? static_cast<int>(check.get(cv::CAP_PROP_FRAME_COUNT)) : 0;
      if (found != frames_) {
        return io_error("{}: cannot write: the file has {} of {} frames; is the disk full?", path_,
                        found, frames_);
      }
    } catch (const std::exception& error) {
      return io_error("{}: cannot write: {}", path_, error.what());
    }
    return rename_over(made_, path_);
  }

 private:
  Status open(int width, int height) {
    if (width % 2 != 0 || height % 2 != 0) {
      return usage_error("{}: mp4 needs an even width and height, not {}x{}; use --size", path_,
                         width, height);
    }
    STGS_TRY(check_can_write(path_));
    STGS_TRY(work_.create(path_));
    made_ = work_.path() + "/video.mp4";
    const cv::Size size(width, height);
    const auto try_codec = [&](const char* c) {
      return writer_.open(made_, cv::CAP_FFMPEG, cv::VideoWriter::fourcc(c[0], c[1], c[2], c[3]),
                          fps_, size);
    };
    if (try_codec("avc1")) return {};
    if (try_codec("mp4v")) {
      log_(1, fmt::format("{}: OpenCV has no H.264 encoder; writing MPEG-4 part 2", path_));
      return {};
    }
    return unsupported("{}: OpenCV has neither an H.264 nor an MPEG-4 encoder; write .y4m", path_);
  }

  std::string path_;
  WorkFolder work_;
  std::string made_;  // the video, in the work folder
  double fps_;
  encoder::LogSink log_;
  cv::VideoWriter writer_;
  cv::Mat bgr_;
  int frames_ = 0;
};

}  // namespace

Result<std::unique_ptr<VideoWriter>> open_mp4_writer(const std::string& path, TimeBase time_base,
                                                     const encoder::LogSink& log) {
  return std::unique_ptr<VideoWriter>(std::make_unique<Mp4Writer>(path, time_base, log));
}

}  // namespace stgs::tools
