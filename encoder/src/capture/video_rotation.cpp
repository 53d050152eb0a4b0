// SPDX-License-Identifier: Apache-2.0
#include "video_rotation.h"

#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
}

namespace stgs::encoder {

int rotation_of(const AVStream& stream) {
#if LIBAVCODEC_VERSION_INT >= AV_VERSION_INT(60, 31, 100)
  const AVPacketSideData* const side =
      av_packet_side_data_get(stream.codecpar->coded_side_data, stream.codecpar->nb_coded_side_data,
                              AV_PKT_DATA_DISPLAYMATRIX);
  const std::uint8_t* const data = side == nullptr ? nullptr : side->data;
  const std::size_t bytes = side == nullptr ? 0 : side->size;
#else
  std::size_t bytes = 0;
  const std::uint8_t* const data =
      av_stream_get_side_data(&stream, AV_PKT_DATA_DISPLAYMATRIX, &bytes);
#endif
  if (data == nullptr || bytes < 9 * sizeof(std::int32_t)) return -1;
  const double angle = av_display_rotation_get(reinterpret_cast<const std::int32_t*>(data));
  if (!std::isfinite(angle)) return -1;
  switch (static_cast<int>(std::lround(-angle / 90)) & 3) {  // FFmpeg's is counter-clockwise
    case 1:
      return cv::ROTATE_90_CLOCKWISE;
    case 2:
      return cv::ROTATE_180;
    case 3:
      return cv::ROTATE_90_COUNTERCLOCKWISE;
    default:
      return -1;
  }
}

}  // namespace stgs::encoder
