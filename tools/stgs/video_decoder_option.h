// SPDX-License-Identifier: Apache-2.0
// --video-decoder of the verbs that read videos.
#pragma once

#include "arguments.h"
#include "usage.h"

namespace stgs::tools {

inline Argument* add_video_decoder(Arguments& app, std::string& value) {
  return with_choices(
             app.add_option("--video-decoder", value,
                            "Decoder of videos and streams: cpu, cuda (NVDEC, an error if it "
                            "cannot be used), or auto: NVDEC where it can be used and pays, "
                            "unless --backend is cpu"),
             {"auto", "cpu", "cuda"})
      ->capture_default_str();
}

}  // namespace stgs::tools
