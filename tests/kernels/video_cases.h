// SPDX-License-Identifier: Apache-2.0
// Videos for tests, decoded by NVDEC and by the CPU.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "capture/video_decoder.h"
#include "catch.h"
#include "fixtures/temporary_folder.h"
#include "fixtures/video_writer.h"

namespace stgs::testing {

using namespace encoder;

inline VideoDecoding on_gpu(bool required = false) {
  const auto device = VideoDevice::open(0);
  INFO(device.status().message());
  REQUIRE(device.ok());
  return {*device, required};
}

struct Decoded {
  std::vector<cv::Mat> images;
  std::vector<double> seconds;
  Status status;  // of the end
  DecodedBy by;
};

inline Result<std::unique_ptr<VideoDecoder>> opened(const std::string& path,
                                                    const VideoDecoding& decoding) {
  return VideoDecoder::open(
      path, path, [](auto) { return Status(); }, decoding);
}

// Decodes the rest of a video.
inline Decoded rest_of(VideoDecoder& decoder) {
  Decoded out;
  while (true) {
    const Result<bool> advanced = decoder.advance();
    if (!advanced.ok() || !*advanced) {
      out.status = advanced.status();
      return out;
    }
    out.by = decoder.decoded_by();
    out.seconds.push_back(decoder.seconds());
    const Result<cv::Mat> image = decoder.image();
    INFO(image.status().message());
    REQUIRE(image.ok());
    out.images.push_back(image->clone());
  }
}

inline Decoded decoded(const std::string& path, const VideoDecoding& decoding) {
  const auto decoder = opened(path, decoding);
  if (decoder.ok()) return rest_of(**decoder);
  Decoded out;
  out.status = decoder.status();
  return out;
}

inline void check_same(const Decoded& found, const Decoded& expected) {
  CHECK(found.status.code() == expected.status.code());
  REQUIRE(found.images.size() == expected.images.size());
  CHECK(std::equal(found.seconds.begin(), found.seconds.end(), expected.seconds.begin(),
                   [](double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }));
  std::string different;  // frames, and their largest difference
  for (std::size_t f = 0; f < found.images.size(); ++f) {
    REQUIRE(found.images[f].size() == expected.images[f].size());
    const double difference = cv::norm(found.images[f], expected.images[f], cv::NORM_INF);
    if (difference > 0) different += fmt::format(" {}: {}", f, difference);
  }
  CHECK(different == "");
}

struct Case {
  const char* name;
  VideoSpec spec;
};

// Returns false if this build of FFmpeg cannot encode the video.
inline bool write_case(const std::string& path, const VideoSpec& spec) {
  if (has_encoder(spec.encoder)) {
    write_video(path, spec);
    return true;
  }
  WARN("no encoder " << spec.encoder);
  return false;
}

}  // namespace stgs::testing
