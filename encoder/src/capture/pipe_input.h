// SPDX-License-Identifier: Apache-2.0
// Input for FFmpeg from a named pipe, which can be stopped while it waits.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "stgs/format/status.h"

extern "C" {
#include <libavformat/avio.h>
}

namespace stgs::encoder {

class PipeInput {
 public:
  // Opens a named pipe without waiting for its writer. kIo on failure. Reading waits for a writer
  // and for data, and ends (AVERROR_EXIT) while `stopped` returns true, or (AVERROR_EOF) when the
  // last writer has closed the pipe.
  static Result<std::unique_ptr<PipeInput>> open(const std::string& path,
                                                 std::function<bool()> stopped);
  ~PipeInput();
  PipeInput(const PipeInput&) = delete;
  PipeInput& operator=(const PipeInput&) = delete;

  AVIOContext* context() const { return context_; }

 private:
  PipeInput(int descriptor, std::function<bool()> stopped)
      : descriptor_(descriptor), stopped_(std::move(stopped)) {}
  static int read(void* self, std::uint8_t* to, int bytes);

  const int descriptor_;
  const std::function<bool()> stopped_;
  bool has_data_ = false;  // a writer has written
  AVIOContext* context_ = nullptr;
};

}  // namespace stgs::encoder
