// SPDX-License-Identifier: Apache-2.0
#include "live_source.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <thread>

#include "capture_files.h"
#include "frame_reader.h"
#include "natural_order.h"
#include "stgs/encoder/image_file.h"
#include "video_decoder.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

constexpr double kPollSeconds = 0.005;   // for the next image
constexpr double kStableSeconds = 0.02;  // for which the size of a complete image does not change
constexpr double kListSeconds = 0.5;     // between two readings of a folder
constexpr std::size_t kMaxNumberDigits = 15;  // of the name of an image
constexpr double kReopenSeconds = 1.0;        // between two attempts to open a stream
constexpr int kLiveImageFlags = cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION;

using Stopped = std::function<bool()>;

std::string label_of(const SourceCamera& camera) {
  return fmt::format("camera '{}'", camera.name);
}

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

void log_decoder(const std::string& label, const DecodedBy& by, const LogSink& log) {
  if (by.gpu)
    log(2, fmt::format("{}: decoded by cuda (NVDEC)", label));
  else if (!by.refusal.empty())
    log(2, fmt::format("{}: decoded by the CPU ({})", label, by.refusal));
}

Status play_video(const CaptureFolder& files, const SourceCamera& camera, const LiveClock& clock,
                  const SourceFrameSink& sink, const LiveReading& reading) {
  const Stopped& stopped = reading.stopped;
  STGS_ASSIGN(const FrameInfo info, probe_frames(files, camera));
  STGS_ASSIGN(const auto video, VideoReader::open(files, camera, 0, reading.decoding));
  STGS_ASSIGN(const FrameMapping* const mapping, reading.mapping({info.width, info.height}));
  for (int frame = 0; frame < info.frames && !stopped(); ++frame) {
    STGS_ASSIGN(const cv::Mat image, video->next(info.width, info.height, mapping));
    if (frame == 0) log_decoder(label_of(camera), video->decoded_by(), reading.log);
    const double seconds = frame / clock.fps();
    if (!wait_until(clock, seconds, stopped)) break;
    STGS_TRY(sink(seconds, image));
  }
  return {};
}

Result<cv::Mat> mapped_image(const cv::Mat& image, const LiveReading& reading) {
  STGS_ASSIGN(const FrameMapping* const mapping, reading.mapping(image.size()));
  return mapping->frame(image);
}

// Plays the images of a recorded capture.
Status play_images(const CaptureFolder& files, const SourceCamera& camera, const LiveClock& clock,
                   const SourceFrameSink& sink, const LiveReading& reading) {
  const Stopped& stopped = reading.stopped;
  for (std::size_t frame = 0; frame < camera.images.size() && !stopped(); ++frame) {
    const std::string what = fmt::format("camera '{}' frame {}", camera.name, frame);
    STGS_ASSIGN(const cv::Mat decoded,
                decode_file(files, camera.images[frame], what, kLiveImageFlags));
    STGS_ASSIGN(const cv::Mat image, mapped_image(decoded, reading));
    const double seconds = static_cast<double>(frame) / clock.fps();
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
    const fs::path file(path);
    const std::string stem = file.stem().string();
    std::size_t begin = stem.size();
    while (begin > 0 && stem.size() - begin < kMaxNumberDigits && stem[begin - 1] >= '0' &&
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

// The images that are written into a folder after the start, in their order.
class GrowingFolder {
 public:
  GrowingFolder(std::string folder, bool allow_outside, const LiveClock& clock)
      : folder_(std::move(folder)), allow_outside_(allow_outside), clock_(clock) {}

  struct Image {
    std::string path;
    std::optional<std::int64_t> number;  // that its name ends in
  };

  // Leaves out the images that exist.
  Status open() {
    STGS_ASSIGN(const std::vector<std::string> all, list());
    if (!all.empty()) last_ = all.back();
    return {};
  }

  // Returns the next complete image, or none yet.
  Result<std::optional<Image>> next() {
    if (pending_.size() < 2) STGS_TRY(look());
    if (pending_.empty() || !is_complete(pending_.front())) return std::optional<Image>();
    Image image{pending_.front(), {}};
    pending_.pop_front();
    if (const auto name = NumberedName::parse(image.path)) image.number = name->number;
    return std::optional<Image>(std::move(image));
  }

 private:
  Result<std::vector<std::string>> list() const {
    STGS_ASSIGN(const auto files, CaptureFolder::open(folder_, allow_outside_));
    return list_images(*files, folder_);
  }

  // Looks for the image with the next number; now and then for all, because a number can be left
  // out.
  Status look() {
    std::error_code ignored;
    if (const auto last = NumberedName::parse(last_)) {
      const std::string next = last->next();
      if (fs::exists(next, ignored)) {
        add(next);
        return {};
      }
    }
    if (clock_.now() < listed_ + kListSeconds) return {};
    listed_ = clock_.now();
    STGS_ASSIGN(const std::vector<std::string> all, list());
    const auto begin = std::upper_bound(all.begin(), all.end(), last_, natural_less);
    std::for_each(begin, all.end(), [this](const std::string& path) { add(path); });
    return {};
  }

  void add(const std::string& path) {
    pending_.push_back(path);
    last_ = path;
  }

  bool is_complete(const std::string& path) {
    if (pending_.size() > 1) return true;  // the next one has begun
    std::error_code error;
    const std::uintmax_t bytes = fs::file_size(path, error);
    if (error) pending_.clear();  // it was removed
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
  const bool allow_outside_;
  const LiveClock& clock_;
  std::deque<std::string> pending_;
  std::string last_;  // that was found
  double listed_ = 0;
  std::string observed_;
  std::uintmax_t observed_bytes_ = 0;
  double observed_at_ = 0;
};

Status follow_images(const std::string& folder, const SourceCamera& camera, LiveClock& clock,
                     const SourceFrameSink& sink, const LiveReading& reading) {
  const Stopped& stopped = reading.stopped;
  STGS_ASSIGN(const auto files, CaptureFolder::open(folder, reading.allow_outside));
  GrowingFolder images(folder, reading.allow_outside, clock);
  STGS_TRY(images.open());
  std::optional<double> arrived;  // the latest image
  for (std::int64_t position = 0; !stopped();) {
    STGS_ASSIGN(const auto image, images.next());
    if (!image) {
      if (arrived && clock.now() - *arrived > kFolderSilence) break;
      sleep_seconds(kPollSeconds);
      continue;
    }
    const std::int64_t number = image->number.value_or(position++);
    const double seconds = clock.of_number(number);
    const std::string what = fmt::format("camera '{}' frame {}", camera.name, number);
    const Result<cv::Mat> decoded = decode_file(*files, image->path, what, kLiveImageFlags);
    if (decoded.ok()) {
      STGS_ASSIGN(const cv::Mat mapped, mapped_image(*decoded, reading));
      STGS_TRY(sink(seconds, mapped));
    } else {
      reading.log(1, "image skipped: " + decoded.status().message());
    }
    arrived = clock.now();
  }
  if (!stopped())
    reading.log(2,
                fmt::format("{}: no image for {:.0f} s; ended", label_of(camera), kFolderSilence));
  return {};
}

// The clock of a stream relative to that of the rig. A frame that arrives later than others,
// relative to its timestamp, was delayed; so the offset is the smallest that was observed.
class StreamClock {
 public:
  // Returns the time of a frame on the clock of the rig. `stated` may be NaN.
  double seconds(double stated, double arrival) {
    if (!std::isfinite(stated)) return arrival;
    const double passed = stated - stated_;
    // The timestamp went back, or ran ahead of real time.
    jumped_ = known_ && (passed < -kMaxDrift || passed > arrival - arrival_ + kMaxDrift);
    offset_ = known_ && !jumped_ ? std::min(offset_, arrival - stated) : arrival - stated;
    known_ = true;
    stated_ = stated;
    arrival_ = arrival;
    return stated + offset_;
  }
  // Returns whether the clock of the stream has jumped at the last frame.
  bool jumped() const { return jumped_; }

 private:
  bool known_ = false, jumped_ = false;
  double offset_ = 0, stated_ = 0, arrival_ = 0;  // the latter two of the last frame
};

// Gives the current frame of a decoder to the sink.
Status deliver(VideoDecoder& decoder, double seconds, const SourceFrameSink& sink,
               const LiveReading& reading) {
  STGS_ASSIGN(const FrameMapping* const mapping, reading.mapping(decoder.size()));
  STGS_ASSIGN(const cv::Mat image, mapped_frame(decoder, *mapping));
  return sink(seconds, image);
}

// Reads a stream until it breaks off, or until deliver() fails: then sets `failed`. Sets `received`
// with its first frame.
Status follow_stream(const std::string& url, const std::string& label, const LiveClock& clock,
                     const SourceFrameSink& sink, const LiveReading& reading, bool& received,
                     bool& failed) {
  STGS_ASSIGN(const auto decoder,
              VideoDecoder::open_stream(url, label, reading.stopped, reading.decoding));
  StreamClock stream;
  while (!reading.stopped()) {
    STGS_ASSIGN(const bool has_frame, decoder->advance());
    if (!has_frame) return {};
    const double seconds = stream.seconds(decoder->seconds(), clock.now());
    if (stream.jumped())
      reading.log(1, label + ": the timestamps of its stream jumped; realigned by arrival time");
    if (!received) log_decoder(label, decoder->decoded_by(), reading.log);
    received = true;
    Status delivered = deliver(*decoder, seconds, sink, reading);
    failed = !delivered.ok();
    if (failed) return delivered;
  }
  return {};
}

// Opens a lost stream again until `stopped` returns true. A pipe is opened once.
Status read_stream(const std::string& url, bool is_pipe, const SourceCamera& camera,
                   const LiveClock& clock, const SourceFrameSink& sink,
                   const LiveReading& reading) {
  const std::string label = label_of(camera);
  const Stopped& stopped = reading.stopped;
  const LogSink& log = reading.log;
  bool reported = false;
  while (!stopped()) {
    bool received = false, failed = false;
    const Status read = follow_stream(url, label, clock, sink, reading, received, failed);
    if (stopped()) break;
    if (failed) return read;
    if (read.code() == StatusCode::kUnsupported && reading.decoding.required) return read;
    if (is_pipe) {
      log(2, fmt::format("{}: the pipe has ended", label));
      return read;
    }
    if (received || !reported) {
      log(1, fmt::format("{}: stream {}{}; retrying every second", label,
                         received ? "lost" : "not available",
                         read.ok() ? "" : " (" + read.message() + ")"));
    }
    reported = true;
    wait_until(clock, clock.now() + kReopenSeconds, stopped);
  }
  return {};
}

enum class SourceKind { kRecorded, kVideo, kFolder, kPipe, kStream };

// Returns the kind of a source, and its path.
Result<std::pair<SourceKind, std::string>> kind_of(const CaptureFolder& files,
                                                   const SourceCamera& camera, bool allow_outside) {
  const std::string& source = camera.live_source;
  const std::string where = fmt::format("{}: camera '{}'", files.path(), camera.name);
  if (source.empty()) {
    if (!camera.video.empty()) return std::pair(SourceKind::kVideo, camera.video);
    if (!camera.images.empty()) return std::pair(SourceKind::kRecorded, std::string());
    return usage_error("{}: no source; add \"source\" to the camera", where);
  }
  if (const std::size_t scheme = source.find("://"); scheme != std::string::npos) {
    if (std::find(kStreamSchemes.begin(), kStreamSchemes.end(), source.substr(0, scheme)) ==
        kStreamSchemes.end()) {
      return usage_error("{}: source '{}' has an unknown scheme (expected {})", where, source,
                         fmt::join(kStreamSchemes, ", "));
    }
    return std::pair(SourceKind::kStream, source);
  }
  std::string path = (fs::path(files.path()) / source).string();
  if (!allow_outside) {
    STGS_ASSIGN(path, files.path_of(source, where));
  }
  std::error_code error;
  const fs::file_status found = fs::status(path, error);
  if (!allow_outside && files.kind(path) == CaptureFolder::Kind::kOutside) {
    return invalid_file("{}: {} leads out of the folder; allow it with --allow-outside", where,
                        path);
  }
  if (fs::is_directory(found)) return std::pair(SourceKind::kFolder, path);
  if (fs::is_fifo(found)) return std::pair(SourceKind::kPipe, path);
  if (fs::is_regular_file(found)) return std::pair(SourceKind::kVideo, path);
  return io_error("{}: {}: not found (expected a video, a folder of images, a named pipe or a URL)",
                  where, path);
}

}  // namespace

void LiveClock::start(double fps) {
  fps_ = fps;
  start_ = Clock::now();
}

double LiveClock::of_number(std::int64_t number) {
  const std::lock_guard lock(mutex_);
  if (!first_) first_ = {number, now()};
  return first_->second + static_cast<double>(number - first_->first) / fps_;
}

bool is_video_source(const CaptureFolder& files, const SourceCamera& camera, bool allow_outside) {
  const auto found = kind_of(files, camera, allow_outside);
  return found.ok() && found->first != SourceKind::kRecorded && found->first != SourceKind::kFolder;
}

Status check_live_source(const CaptureFolder& files, const SourceCamera& camera,
                         bool allow_outside) {
  return kind_of(files, camera, allow_outside).status();
}

Status read_live_source(const CaptureFolder& files, const SourceCamera& camera, LiveClock& clock,
                        const SourceFrameSink& sink, const LiveReading& reading) {
  STGS_ASSIGN(const auto found, kind_of(files, camera, reading.allow_outside));
  const auto& [kind, path] = found;
  switch (kind) {
    case SourceKind::kRecorded:
      return play_images(files, camera, clock, sink, reading);
    case SourceKind::kVideo: {
      SourceCamera video = camera;
      video.video = path;
      return play_video(files, video, clock, sink, reading);
    }
    case SourceKind::kFolder:
      return follow_images(path, camera, clock, sink, reading);
    case SourceKind::kPipe:
    case SourceKind::kStream:
      return read_stream(path, kind == SourceKind::kPipe, camera, clock, sink, reading);
  }
  return {};
}

}  // namespace stgs::encoder
