// SPDX-License-Identifier: Apache-2.0
// Converts decoded video frames to RGB with FFmpeg's swscale.
#pragma once

#include <memory>
#include <opencv2/core.hpp>

#include "geometry/frame_warp.h"
#include "stgs/format/status.h"

extern "C" {
#include <libavutil/frame.h>
#include <libswscale/swscale.h>
}

namespace stgs::encoder {

// Returns an error of FFmpeg: kNoMemory, kIo if the system refuses a call, kUnsupported for
// features that FFmpeg lacks, else kInvalidFile. The message is FFmpeg's text, without a path.
Status ffmpeg_error(int error);

// Not thread-safe. Errors are those of ffmpeg_error().
class FrameConverter {
 public:
  // Returns a frame as 8-bit BGR. Chroma is interpolated from its stated position. kUnsupported if
  // the frame states a matrix other than BT.601, FCC, SMPTE 240M, BT.709 or BT.2020. `stated`: the
  // format of the video, which may imply a range; that of the frame may be another layout of it.
  Result<cv::Mat> convert(const AVFrame& frame, AVPixelFormat stated);

  // Returns how a GPU converts a 4:2:0 frame with the result of convert(): null if it cannot. The
  // next call returns the same object for a frame with the same properties. The planes may be those
  // of a GPU.
  std::shared_ptr<const geometry::YuvRule> gpu_rule(const AVFrame& frame, AVPixelFormat stated);

 private:
  // The properties on which the conversion depends.
  struct Form {
    int width = 0, height = 0;
    AVPixelFormat pixels = AV_PIX_FMT_NONE;
    AVColorSpace matrix = AVCOL_SPC_UNSPECIFIED;
    AVChromaLocation chroma = AVCHROMA_LOC_UNSPECIFIED;
    bool full_range = false;
    bool operator==(const Form&) const = default;
  };
  struct FreeScaler {
    void operator()(SwsContext* scaler) const { sws_freeContext(scaler); }
  };
  using Scaler = std::unique_ptr<SwsContext, FreeScaler>;

  static Form form_of(const AVFrame& frame, AVPixelFormat stated);
  static Result<Scaler> make_scaler(const Form& form);

  Scaler scaler_;
  Form form_;  // of scaler_
  std::shared_ptr<const geometry::YuvRule> rule_;
  Form rule_form_;  // of rule_
};

}  // namespace stgs::encoder
