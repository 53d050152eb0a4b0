// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "output_path.h"
#include "standard_streams.h"
#include "video.h"

namespace stgs::tools {
namespace {

// BT.709 luma weights.
constexpr float kRed = 0.2126f, kGreen = 0.7152f, kBlue = 0.0722f;

std::uint8_t code(float v) {
  return static_cast<std::uint8_t>(std::clamp(v + 0.5f, 0.0f, 255.0f));
}

class Y4mWriter final : public VideoWriter {
 public:
  Y4mWriter(std::string path, TimeBase time_base) : path_(std::move(path)), time_base_(time_base) {}

  Status add(const encoder::Image8& frame) override {
    if (!begun_) {
      STGS_TRY(open());
      // C444 is 8-bit 4:4:4. The frame rate is the inverse of the time base.
      STGS_TRY(write_text(fmt::format("YUV4MPEG2 W{} H{} F{}:{} Ip A1:1 C444 XCOLORRANGE=LIMITED\n",
                                      frame.width, frame.height, time_base_.denominator,
                                      time_base_.numerator)));
      begun_ = true;
    }
    STGS_TRY(write_text("FRAME\n"));
    const std::size_t pixels = static_cast<std::size_t>(frame.width) * frame.height;
    planes_.resize(3 * pixels);
    for (std::size_t i = 0; i < pixels; ++i) {
      const float r = static_cast<float>(frame.data[3 * i]) / 255.0f;
      const float g = static_cast<float>(frame.data[3 * i + 1]) / 255.0f;
      const float b = static_cast<float>(frame.data[3 * i + 2]) / 255.0f;
      const float y = kRed * r + kGreen * g + kBlue * b;
      planes_[i] = code(16.0f + 219.0f * y);
      planes_[pixels + i] = code(128.0f + 224.0f * (b - y) / (2.0f * (1.0f - kBlue)));
      planes_[2 * pixels + i] = code(128.0f + 224.0f * (r - y) / (2.0f * (1.0f - kRed)));
    }
    return write(planes_);
  }

  Status finish() override { return is_stream() ? Status() : file_.commit(); }

 private:
  bool is_stream() const { return path_ == "-"; }
  Status open() {
    if (is_stream()) return {};
    STGS_TRY(check_can_write(path_));
    return file_.open(path_);
  }
  Status write(std::span<const std::uint8_t> bytes) {
    return is_stream() ? write_standard_output(bytes) : file_.write(bytes);
  }
  Status write_text(const std::string& text) {
    return write({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }

  std::string path_;
  TimeBase time_base_;
  OutputFile file_;
  std::vector<std::uint8_t> planes_;
  bool begun_ = false;
};

}  // namespace

std::unique_ptr<VideoWriter> make_y4m_writer(const std::string& path, TimeBase time_base) {
  return std::make_unique<Y4mWriter>(path, time_base);
}

}  // namespace stgs::tools
