// SPDX-License-Identifier: Apache-2.0
#include "live_source.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <thread>

#include "capture_files.h"
#include "frame_reader.h"
#include "stgs/encoder/image_file.h"
#include "video_decoder.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

constexpr double kPollSeconds = 0.005;   // for the next image
constexpr double kStableSeconds = 0.02;  // for which the size of a complete image does not change
constexpr double kListSeconds = 0.5;     // between two readings of a folder
constexpr double kReopenSeconds = 1.0;   // between two attempts to open a stream
constexpr int kLiveImageFlags = cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION;

using Stopped = std::function<bool()>;

void sleep_seconds(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

// Returns false if it was stopped.
bool wait_until(const LiveClock& clock, double seconds, const Stopped& stopped) {
  while (!stopped()) {
    const double left = seconds - clock.now();
    if (left <= 0) return true;
    sleep_seconds(std::min(left, 0.05));
  }
  return false;
}

Status play_video(const CaptureFolder& files, const SourceCamera& camera, const LiveClock& clock,
                  const SourceFrameSink& sink, const Stopped& stopped) {
  STGS_ASSIGN(const FrameInfo info, probe_frames(files, camera));
  STGS_ASSIGN(const auto video, VideoReader::open(files, camera, 0));
  for (int frame = 0; frame < info.frames && !stopped(); ++frame) {
    STGS_ASSIGN(const cv::Mat image, video->next(info.width, info.height));
    const double seconds = frame / clock.fps;
    if (!wait_until(clock, seconds, stopped)) break;
    STGS_TRY(sink(seconds, image));
  }
  return {};
}

// The digits that end the stem of an image file.
struct NumberedName {
  std::string prefix, extension;  // with the folder; with the dot
  std::size_t digits = 0;
  std::int64_t number = 0;

  static std::optional<NumberedName> parse(const std::string& path) {
    constexpr std::size_t kMost = 15;
    const fs::path file(path);
    const std::string stem = file.stem().string();
    std::size_t begin = stem.size();
    while (begin > 0 && stem.size() - begin < kMost && stem[begin - 1] >= '0' &&
           stem[begin - 1] <= '9')
      --begin;
    if (begin == stem.size()) return std::nullopt;
    return NumberedName{(file.parent_path() / stem.substr(0, begin)).string(),
                        file.extension().string(), stem.size() - begin,
                        std::stoll(stem.substr(begin))};
  }
  std::string next() const {
    return fmt::format("{}{:0{}}{}", prefix, number + 1, digits, extension);
  }
};

// The images of a folder in their order, while further ones are written.
class GrowingFolder {
 public:
  GrowingFolder(std::string folder, const LiveClock& clock)
      : folder_(std::move(folder)), clock_(clock) {}

  struct Image {
    std::string path;
    std::int64_t index = 0;  // its number, or its position
  };

  // Returns the next complete image, or none yet.
  Result<std::optional<Image>> next() {
    if (pending_.empty()) STGS_TRY(look());
    if (pending_.empty() || !is_complete(pending_.front())) return std::optional<Image>();
    Image image{pending_.front(), position_++};
    pending_.erase(pending_.begin());
    last_ = NumberedName::parse(image.path);
    last_path_ = image.path;
    if (last_) image.index = last_->number;
    return std::optional<Image>(image);
  }

 private:
  // Looks for the image with the next number; now and then for all.
  Status look() {
    std::error_code ignored;
    if (last_ && fs::exists(last_->next(), ignored)) {
      pending_.push_back(last_->next());
      return {};
    }
    if (clock_.now() < listed_ + kListSeconds) return {};
    listed_ = clock_.now();
    STGS_ASSIGN(const auto files, CaptureFolder::open(folder_, true));
    STGS_ASSIGN(const std::vector<std::string> all, list_images(*files, folder_));
    const auto begin = std::find(all.begin(), all.end(), last_path_);
    pending_.assign(begin == all.end() ? all.begin() : begin + 1, all.end());
    return {};
  }

  bool is_complete(const std::string& path) {
    if (pending_.size() > 1) return true;  // the next one has begun
    std::error_code error;
    const std::uintmax_t bytes = fs::file_size(path, error);
    if (error || bytes == 0) return false;
    const double now = clock_.now();
    if (path != observed_ || bytes != observed_bytes_) {
      observed_ = path;
      observed_bytes_ = bytes;
      observed_at_ = now;
    }
    return now - observed_at_ >= kStableSeconds;
  }

  const std::string folder_;
  const LiveClock& clock_;
  std::vector<std::string> pending_;
  std::string last_path_;
  std::optional<NumberedName> last_;
  std::int64_t position_ = 0;
  double listed_ = -kListSeconds;
  std::string observed_;
  std::uintmax_t observed_bytes_ = 0;
  double observed_at_ = 0;
};

Status follow_images(const std::string& folder, const SourceCamera& camera, const LiveClock& clock,
                     const SourceFrameSink& sink, const Stopped& stopped, const LogSink& log) {
  STGS_ASSIGN(const auto files, CaptureFolder::open(folder, true));
  GrowingFolder images(folder, clock);
  double arrived = clock.now();
  while (!stopped()) {
    STGS_ASSIGN(const auto image, images.next());
    if (!image) {
      if (clock.now() - arrived > kFolderSilence) break;
      sleep_seconds(kPollSeconds);
      continue;
    }
    const std::string what = fmt::format("camera '{}' frame {}", camera.name, image->index);
    const Result<cv::Mat> decoded = decode_file(*files, image->path, what, kLiveImageFlags);
    if (!decoded.ok()) {
      log(1, "skipped: " + decoded.status().message());
    } else {
      const double seconds = static_cast<double>(image->index) / clock.fps;
      if (!wait_until(clock, seconds, stopped)) break;
      STGS_TRY(sink(seconds, *decoded));
    }
    arrived = clock.now();
  }
  return {};
}

// Reads a stream until it breaks off. Sets `received` with its first frame.
Status follow_stream(const std::string& url, const std::string& label, const LiveClock& clock,
                     const SourceFrameSink& sink, const Stopped& stopped, const LogSink& log,
                     bool& received) {
  STGS_ASSIGN(const auto decoder, VideoDecoder::open_stream(url, label, stopped));
  double offset = 0;  // from the stream's clock to that of the rig
  bool aligned = false;
  while (!stopped()) {
    STGS_ASSIGN(const bool has_frame, decoder->advance());
    if (!has_frame) return {};
    STGS_ASSIGN(const cv::Mat image, decoder->image());
    const double arrival = clock.now(), stated = decoder->seconds();
    double seconds = std::isfinite(stated) ? stated + offset : arrival;
    if (!aligned || std::abs(seconds - arrival) > kMaxDrift) {
      if (aligned) {
        log(1, fmt::format("{}: its time jumps by {:.2f} s; aligned again by its arrival", label,
                           arrival - seconds));
      }
      aligned = true;
      if (std::isfinite(stated)) offset = arrival - stated;
      seconds = arrival;
    }
    received = true;
    STGS_TRY(sink(seconds, image));
  }
  return {};
}

// A stream is opened again until it is stopped, a pipe is not.
Status read_stream(const std::string& url, bool is_pipe, const SourceCamera& camera,
                   const LiveClock& clock, const SourceFrameSink& sink, const Stopped& stopped,
                   const LogSink& log) {
  const std::string label = fmt::format("camera '{}'", camera.name);
  bool reported = false;
  while (!stopped()) {
    bool received = false;
    Status status;
    const auto checked = [&](double seconds, const cv::Mat& image) {
      return status = sink(seconds, image);
    };
    const Status read = follow_stream(url, label, clock, checked, stopped, log, received);
    if (stopped()) break;
    if (!status.ok()) return status;
    if (is_pipe) return received ? Status() : read;
    if (received || !reported) {
      log(1, fmt::format("{}: the stream has {}{}; opening it again every second", label,
                         received ? "broken off" : "not been received",
                         read.ok() ? "" : " (" + read.message() + ")"));
    }
    reported = true;
    wait_until(clock, clock.now() + kReopenSeconds, stopped);
  }
  return {};
}

}  // namespace

Status read_live_source(const CaptureFolder& files, const SourceCamera& camera,
                        const LiveClock& clock, const SourceFrameSink& sink,
                        const std::function<bool()>& stopped, const LogSink& log) {
  if (camera.live_source.empty()) {
    if (!camera.video.empty()) return play_video(files, camera, clock, sink, stopped);
    return follow_images(fs::path(camera.images.at(0)).parent_path().string(), camera, clock, sink,
                         stopped, log);
  }
  if (camera.live_source.find("://") != std::string::npos)
    return read_stream(camera.live_source, false, camera, clock, sink, stopped, log);
  const fs::path path = fs::path(files.path()) / camera.live_source;
  std::error_code error;
  const fs::file_status found = fs::status(path, error);
  if (fs::is_directory(found))
    return follow_images(path.string(), camera, clock, sink, stopped, log);
  if (fs::is_fifo(found))
    return read_stream(path.string(), true, camera, clock, sink, stopped, log);
  if (fs::is_regular_file(found)) {
    SourceCamera video = camera;
    STGS_ASSIGN(video.video, files.path_of(camera.live_source, "source of camera " + camera.name));
    return play_video(files, video, clock, sink, stopped);
  }
  return io_error(
      "{}: source of camera '{}' not found (expected a video, a folder of images, a named pipe or "
      "a "
      "URL)",
      path.string(), camera.name);
}

}  // namespace stgs::encoder
