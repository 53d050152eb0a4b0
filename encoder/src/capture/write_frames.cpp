// SPDX-License-Identifier: Apache-2.0
#include "write_frames.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <map>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "file_kind.h"
#include "plural.h"
#include "reporting.h"
#include "stgs/encoder/frame_memory.h"
#include "stgs/encoder/image_file.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kBatchFrames = 4;  // per camera

// Keeps the error of the lowest camera, then frame, and stops the workers. Thread-safe.
class FirstError {
 public:
  void set(Status status, std::size_t camera, int frame) {
    const std::lock_guard lock(mutex_);
    if (!status_.ok() && std::pair(camera_, frame_) <= std::pair(camera, frame)) return;
    status_ = std::move(status);
    camera_ = camera;
    frame_ = frame;
    stop_ = true;
  }
  bool stop() const { return stop_; }
  const Status& status() const { return status_; }

 private:
  std::mutex mutex_;
  Status status_;
  std::size_t camera_ = 0;
  int frame_ = 0;
  std::atomic<bool> stop_{false};
};

// Does not sync: the folder is renamed when complete, and can be prepared again after a crash.
Status write_bytes(const std::string& path, const std::vector<std::uint8_t>& bytes) {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (file == nullptr) return io_error("{}: cannot create: {}", path, system_message(errno));
  const bool wrote = std::fwrite(bytes.data(), 1, bytes.size(), file) == bytes.size();
  const int write_error = errno;
  if (std::fclose(file) != 0 || !wrote) {
    return io_error("{}: cannot write: {}", path, system_message(wrote ? errno : write_error));
  }
  return {};
}

Status write_png(const std::string& path, const cv::Mat& image) {
  std::vector<std::uint8_t> bytes;
  // Without parameters OpenCV uses its fastest PNG settings. Any explicit level tries all filters.
  if (!cv::imencode(".png", image, bytes)) {
    return runtime_error("{}: cannot encode the image as PNG", path);
  }
  return write_bytes(path, bytes);
}

bool all_png(const std::vector<std::string>& paths) {
  return std::all_of(paths.begin(), paths.end(),
                     [](const std::string& path) { return fs::path(path).extension() == ".png"; });
}

// Input and output of one camera.
struct CameraJob {
  const CaptureFolder& files;
  const SourceCamera& source;
  const CameraPlan& plan;
  const FrameMapping& mapping;
  const PreparedCapture& capture;
  const Camera& camera;

  // Returns the number in the source camera's own sequence of the image that is a frame.
  int number_of(int frame) const { return static_cast<int>(capture.own_frame(camera, frame)); }

  // Returns true if the image files are copied byte for byte.
  bool copies() const {
    return plan.is_identity() && source.video.empty() &&
           (capture.frame_extension == "jpg" || all_png(source.images));
  }
};

Status copy_image(const CameraJob& job, int frame) {
  const int number = job.number_of(frame);
  const std::string& path = job.source.images[static_cast<std::size_t>(number)];
  if (!job.files.exists(path)) {
    return io_error("{}: camera '{}' frame {} not found", path, job.source.name, number);
  }
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes,
              job.files.read(path, kCaptureLimits.file_bytes));
  STGS_TRY(
      check_image_kind(bytes, path, fmt::format("camera '{}' frame {}", job.source.name, number)));
  // Training decodes these bytes with the same decoder.
  Result<Image8> image = decode_image8(bytes, 3, path);
  if (!image.ok()) {
    return invalid_file("camera '{}' frame {}: {}", job.source.name, number,
                        image.status().message());
  }
  if (image->width != job.camera.width || image->height != job.camera.height) {
    return invalid_file(
        "{}: camera '{}' frame {} differs in size from its first frame (expected {}x{}, got {}x{})",
        path, job.source.name, number, job.camera.width, job.camera.height, image->width,
        image->height);
  }
  if (job.capture.memory) job.capture.memory->add_frame(job.camera.name, frame, std::move(*image));
  return job.capture.memory_only ? Status()
                                 : write_bytes(job.capture.frame_path(job.camera, frame), bytes);
}

Status write_mask(const CameraJob& job, int frame) {
  if (job.source.masks.empty()) return {};
  const int number = job.number_of(frame);
  const std::string& path = job.source.masks[static_cast<std::size_t>(number)];
  STGS_ASSIGN(const cv::Mat mask,
              decode_file(job.files, path,
                          fmt::format("mask of camera '{}' frame {}", job.source.name, number),
                          cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION));
  if (mask.cols != job.plan.source.width || mask.rows != job.plan.source.height) {
    return invalid_file(
        "{}: mask of camera '{}' frame {} differs in size from the frame (expected {}x{}, got "
        "{}x{})",
        path, job.source.name, number, job.plan.source.width, job.plan.source.height, mask.cols,
        mask.rows);
  }
  const cv::Mat mapped = job.mapping.mask(mask);
  if (job.capture.memory) {
    job.capture.memory->add_mask(job.camera.name, frame,
                                 {mapped.cols, mapped.rows, 1, {mapped.datastart, mapped.dataend}});
  }
  return job.capture.memory_only ? Status()
                                 : write_png(job.capture.mask_path(job.camera, frame), mapped);
}

// Writes a frame, and retains it in memory.
Status write_mapped(const CameraJob& job, int frame, const cv::Mat& mapped) {
  const PreparedCapture& capture = job.capture;
  if (capture.memory) {
    Image8 image{mapped.cols, mapped.rows, 3, {}};
    image.data.resize(mapped.total() * 3);
    cv::cvtColor(mapped, cv::Mat(mapped.size(), CV_8UC3, image.data.data()), cv::COLOR_BGR2RGB);
    capture.memory->add_frame(job.camera.name, frame, std::move(image));
  }
  return capture.memory_only ? Status() : write_png(capture.frame_path(job.camera, frame), mapped);
}

Status write_unguarded(const CameraJob& job, bool copies, int frame, cv::Mat decoded) {
  STGS_TRY(write_mask(job, frame));
  if (copies) return copy_image(job, frame);
  if (decoded.empty()) {
    STGS_ASSIGN(decoded, read_image(job.files, job.source, job.number_of(frame),
                                    job.plan.source.width, job.plan.source.height));
  } else if (job.mapping.is_on_gpu()) {
    return write_mapped(job, frame, decoded);
  }
  STGS_ASSIGN(const cv::Mat mapped, job.mapping.frame(decoded));
  return write_mapped(job, frame, mapped);
}

// Writes one frame. `decoded` is that of read_frame(), or empty for an image frame.
Status write_frame(const CameraJob& job, bool copies, int frame, cv::Mat decoded) {
  try {
    return write_unguarded(job, copies, frame, std::move(decoded));
  } catch (const std::exception& error) {
    return runtime_error("camera '{}' frame {}: {}", job.source.name, job.number_of(frame),
                         error.what());
  }
}

// Opens the video of a camera before its image that is frame 0.
Status open_source(const CameraJob& job, const VideoDecoding& decoding, SourceVideo& video) {
  if (video.reader || job.source.video.empty()) return {};
  const int first = job.number_of(0);
  STGS_ASSIGN(video.reader, VideoReader::open(job.files, job.source, first, decoding));
  video.next = first;
  return {};
}

// Reads the video up to the image that is a frame. Cameras with a frame rate of their own skip
// images, or have one image for several frames. A GPU changes the frame while it is at hand; the
// CPU changes it on the thread that writes it.
Result<cv::Mat> read_frame(const CameraJob& job, SourceVideo& video, int frame) {
  try {
    const FrameMapping* const mapping = job.mapping.is_on_gpu() ? &job.mapping : nullptr;
    while (video.next <= job.number_of(frame)) {
      STGS_ASSIGN(video.latest,
                  video.reader->next(job.plan.source.width, job.plan.source.height, mapping));
      ++video.next;
    }
    return video.latest;
  } catch (const std::exception& error) {
    return runtime_error("{}: camera '{}' frame {}: {}", job.source.video, job.source.name,
                         job.number_of(frame), error.what());
  }
}

struct Step {
  int frame = 0;
  cv::Mat decoded;
};

// Writes all frames of a camera, in batches. A batch of video frames is decoded in order; then all
// threads undistort, encode and write its frames.
void write_camera(const CameraJob& job, std::size_t index, OpenVideos& videos, Counter& counter,
                  FirstError& error) {
  SourceVideo& video = videos.videos[index];
  if (Status opened = open_source(job, videos.decoding, video); !opened.ok())
    return error.set(std::move(opened), index, 0);
  const bool copies = job.copies();
  int next = 0;
  const auto read = [&]() -> std::optional<Step> {
    if (next == job.capture.frames || counter.cancelled || error.stop()) return std::nullopt;
    Step step{next, {}};
    if (video.reader) {
      Result<cv::Mat> image = read_frame(job, video, next);
      if (!image.ok()) {
        error.set(image.status(), index, next);
        return std::nullopt;
      }
      step.decoded = std::move(*image);
    }
    ++next;
    return step;
  };
  const auto write = [&](Step& step) {
    Status status = write_frame(job, copies, step.frame, std::move(step.decoded));
    if (!status.ok()) error.set(std::move(status), index, step.frame);
    ++counter.done;
  };
  std::vector<Step> steps;
  do {
    steps.clear();
    while (steps.size() < kBatchFrames) {
      std::optional<Step> step = read();
      if (!step) break;
      steps.push_back(std::move(*step));
    }
    parallel_for(std::size_t{0}, steps.size(), [&](std::size_t i) { write(steps[i]); });
  } while (!steps.empty());
}

}  // namespace

Status write_frames(const SourceCapture& source, const std::vector<CameraPlan>& plans,
                    const PreparedCapture& capture, OpenVideos& videos,
                    const ProgressSink& progress) {
  if (videos.videos.empty() || videos.next_frame != capture.first_frame) {
    videos.videos.clear();
    videos.videos.resize(plans.size());
  }
  videos.next_frame = capture.first_frame + capture.frames;
  for (std::size_t i = 0; i < plans.size(); ++i) {
    const Camera& camera = capture.cameras[i];
    if (capture.memory_only) break;
    fs::create_directories(fs::path(capture.frame_path(camera, 0)).parent_path());
    if (!source.cameras[i].masks.empty()) {
      fs::create_directories(fs::path(capture.mask_path(camera, 0)).parent_path());
    }
  }
  // After an error or a cancellation the readers are at unknown frames.
  const auto clear = [&videos](Status status) {
    if (!status.ok()) videos.videos.clear();
    return status;
  };
  FirstError error;
  const std::uint64_t total = plans.size() * static_cast<std::uint64_t>(capture.frames);
  return clear(run_reporting("frames", total, progress, [&](Counter& counter) -> Status {
    parallel_for(std::size_t{0}, plans.size(), [&](std::size_t i) {
      if (counter.cancelled || error.stop()) return;
      const auto mapping = FrameMapping::make(plans[i], videos.mapping_device);
      if (!mapping.ok()) return error.set(mapping.status(), i, 0);
      const CameraJob job{*source.files, source.cameras[i], plans[i],
                          **mapping,     capture,           capture.cameras[i]};
      write_camera(job, i, videos, counter, error);
    });
    return error.status();
  }));
}

void log_decoders(const SourceCapture& source, const OpenVideos& videos, const LogSink& log) {
  std::size_t on_gpu = 0;
  std::map<std::string, std::vector<std::string>> on_cpu;  // cameras by reason
  for (std::size_t i = 0; i < videos.videos.size(); ++i) {
    if (!videos.videos[i].reader) continue;
    const DecodedBy by = videos.videos[i].reader->decoded_by();
    if (by.gpu)
      ++on_gpu;
    else
      on_cpu[by.refusal].push_back(source.cameras[i].name);
  }
  if (on_gpu > 0) {
    log(2, fmt::format("{}: {} decoded by cuda (NVDEC, {})", source.folder, plural(on_gpu, "video"),
                       videos.decoding.device->name()));
  }
  for (const auto& [reason, cameras] : on_cpu) {
    log(2, fmt::format(
               "{}: {} decoded by the CPU{}", source.folder, plural(cameras.size(), "video"),
               reason.empty() ? ""
                              : fmt::format(" (camera {}: {})", fmt::join(cameras, ", "), reason)));
  }
}

}  // namespace stgs::encoder
