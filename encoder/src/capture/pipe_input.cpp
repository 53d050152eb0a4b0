// SPDX-License-Identifier: Apache-2.0
#include "pipe_input.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>

extern "C" {
#include <libavutil/error.h>
#include <libavutil/mem.h>
}

namespace stgs::encoder {
namespace {

constexpr int kPollMilliseconds = 50;
constexpr int kBufferBytes = 1 << 16;

}  // namespace

Result<std::unique_ptr<PipeInput>> PipeInput::open(const std::string& path,
                                                   std::function<bool()> stopped) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (descriptor < 0) return io_error("{}: cannot open: {}", path, std::strerror(errno));
  std::unique_ptr<PipeInput> input(new PipeInput(descriptor, std::move(stopped)));
  auto* const buffer = static_cast<unsigned char*>(av_malloc(kBufferBytes));
  if (buffer != nullptr) {
    input->context_ =
        avio_alloc_context(buffer, kBufferBytes, 0, input.get(), read, nullptr, nullptr);
    if (input->context_ == nullptr) av_free(buffer);
  }
  if (input->context_ == nullptr)
    return Status(StatusCode::kNoMemory, path + ": not enough memory");
  return input;
}

PipeInput::~PipeInput() {
  if (context_ != nullptr) {
    av_freep(&context_->buffer);  // FFmpeg may have replaced it
    avio_context_free(&context_);
  }
  ::close(descriptor_);
}

int PipeInput::read(void* self, std::uint8_t* to, int bytes) {
  auto* const input = static_cast<PipeInput*>(self);
  while (!input->stopped_()) {
    pollfd waiting{input->descriptor_, POLLIN, 0};
    const int ready = ::poll(&waiting, 1, kPollMilliseconds);
    if (ready < 0 && errno != EINTR) return AVERROR(errno);
    if (ready <= 0) continue;
    const ssize_t got = ::read(input->descriptor_, to, static_cast<std::size_t>(bytes));
    if (got > 0) {
      input->has_data_ = true;
      return static_cast<int>(got);
    }
    if (got < 0 && errno != EAGAIN && errno != EINTR) return AVERROR(errno);
    if (got == 0 && input->has_data_) return AVERROR_EOF;
    // Without a writer, poll() does not wait.
    std::this_thread::sleep_for(std::chrono::milliseconds(kPollMilliseconds));
  }
  return AVERROR_EXIT;
}

}  // namespace stgs::encoder
