// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/live_preparer.h"

#include <algorithm>
#include <filesystem>
#include <mutex>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "camera_plan.h"
#include "capture_files.h"
#include "geometry/velocity_matcher.h"
#include "geometry/view_matcher.h"
#include "init/background.h"
#include "init_settings.h"
#include "live_source.h"
#include "plural.h"
#include "serial_opencv.h"
#include "stgs/encoder/camera_json.h"
#include "stgs/encoder/device_image.h"
#include "timing_file.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

constexpr double kSettleSeconds = 8;      // after which static content becomes background
constexpr const char* kGivenRig = "rig";  // its name in messages
constexpr int kSameOrder = -1;            // no conversion of cv::cvtColor

Result<SourceCamera> source_of(const RigCamera& given) {
  SourceCamera camera;
  camera.name = given.name;
  const std::string where = fmt::format("{}: camera '{}'", kGivenRig, given.name);
  STGS_TRY(
      set_intrinsics({given.fx, 0, given.cx, 0, given.fy, given.cy, 0, 0, 1}, 0.5, where, camera));
  STGS_TRY(set_pose({given.world_to_camera.begin(), given.world_to_camera.end()}, where, camera));
  if (given.fisheye || !given.distortion.empty())
    STGS_TRY(set_distortion(given.distortion, given.fisheye, where, camera));
  if (given.width != 0 || given.height != 0)
    STGS_TRY(set_size(given.width, given.height, where, camera));
  return camera;
}

Result<SourceCapture> source_of(const std::vector<RigCamera>& cameras) {
  SourceCapture rig;
  rig.layout = Layout::kVideos;
  rig.folder = kGivenRig;
  for (const RigCamera& camera : cameras) {
    STGS_ASSIGN(rig.cameras.emplace_back(), source_of(camera));
  }
  STGS_TRY(check_source(rig, true));
  return rig;
}

class Rig final : public LivePreparer {
 public:
  Rig(PrepareSettings settings, std::string name)
      : settings_(std::move(settings)), name_(std::move(name)) {}

  Status open(const std::vector<RigCamera>& cameras, double fps) {
    STGS_ASSIGN(source_, source_of(cameras));
    return take_cameras(fps, {});
  }

  Status open(double fps, const LogSink& log) {
    STGS_TRY(load(log));
    if (source_.has_timing) {
      return usage_error(
          "{}: has timing.json, but live encoding needs synchronised cameras; "
          "synchronise them and remove the file",
          name_);
    }
    return take_cameras(fps, log);
  }

  Status choose_backend(const LogSink& log) {
    STGS_ASSIGN(decoding_, choose_video_decoding(settings_, has_video() ? kEndless : 0, log));
    STGS_ASSIGN(mapping_device_, choose_mapping_device(settings_, log));
    STGS_ASSIGN(motion_finder_,
                geometry::make_motion_finder(settings_.backend, settings_.share.index, log));
    STGS_ASSIGN(sweeper_,
                geometry::make_hull_sweeper(settings_.backend, settings_.share.index, log));
    STGS_ASSIGN(velocity_matcher_,
                geometry::make_velocity_matcher(settings_.backend, settings_.share.index, log));
    return {};
  }

  // Returns whether a camera is read from a video or a stream.
  bool has_video() const {
    return std::any_of(source_.cameras.begin(), source_.cameras.end(), [&](const auto& camera) {
      return source_.files && is_video_source(*source_.files, camera, settings_.allow_outside);
    });
  }

  const std::vector<LiveCamera>& cameras() const override { return cameras_; }
  double fps() const override { return fps_; }

  Result<Image8> convert(std::size_t camera, const LiveImage& image) override {
    const KeptDevice kept;  // of the application, on whose thread the GPU is used
    try {
      return convert_image(camera, image);
    } catch (const std::exception& error) {
      return Status(code_of(error),
                    fmt::format("camera '{}': {}", cameras_[camera].name, error.what()));
    }
  }

  Status read_source(std::size_t camera, const LiveFrameSink& sink,
                     const std::function<bool()>& stopped, const LogSink& log) override {
    STGS_TRY(check_has_sources());
    std::call_once(started_, [this] { clock_.start(fps_); });
    const auto push = [&](double seconds, const cv::Mat& bgr) {
      sink(camera, seconds, image_of(bgr, cv::COLOR_BGR2RGB));
      return Status();
    };
    const auto mapping = [&](cv::Size size) { return mapping_of(camera, size); };
    try {
      return read_live_source(*source_.files, source_.cameras[camera], clock_, push,
                              {stopped, settings_.allow_outside, decoding_, log, mapping});
    } catch (const std::exception& error) {
      return runtime_error("camera '{}': {}", cameras_[camera].name, error.what());
    }
  }

  Status check_sources() const override {
    STGS_TRY(check_has_sources());
    for (const SourceCamera& camera : source_.cameras)
      STGS_TRY(check_live_source(*source_.files, camera, settings_.allow_outside));
    return {};
  }

  Result<PreparedCapture> start(const std::vector<bool>& takes_part) override {
    PreparedCapture rig;
    rig.source = layout_name(source_.layout);
    rig.metric = source_.metric;
    rig.time_base = frame_time_of(fps_);
    rig.memory_only = true;
    for (std::size_t i = 0; i < cameras_.size(); ++i) {
      if (!takes_part[i]) continue;
      if (!mapped_[i]) return usage_error("camera '{}': no frame was converted", cameras_[i].name);
      STGS_TRY(check_camera(mapped_[i]->plan.camera, name_));
      rig.cameras.push_back(mapped_[i]->plan.camera);
    }
    if (rig.cameras.size() < 2) {
      return runtime_error("{}: {} delivered frames (expected at least 2)", name_,
                           plural(rig.cameras.size(), "camera"));
    }
    backgrounds_ = std::make_shared<init::LiveBackgrounds>(
        std::max(1, static_cast<int>(kSettleSeconds * fps_)));
    return rig;
  }

  Status prepare(PreparedCapture& window, int point_interval, const ProgressSink& progress,
                 const LogSink& log) override {
    InitSettings init = init_settings(name_, settings_);
    init.separate_motion = true;
    init.write_report = false;
    init.live = backgrounds_;
    init.motion_finder = motion_finder_;
    init.sweeper = sweeper_;
    init.velocity_matcher = velocity_matcher_;
    init.point_interval = point_interval;
    const LogSink log_or_none = log ? log : [](int, const std::string&) {};
    try {
      STGS_TRY(findings_ ? initialise_later(window, init, *findings_, progress, log_or_none)
                         : initialise(window, init, progress, log_or_none, &findings_));
      return write_prepared_capture(window);
    } catch (const std::exception& error) {
      return runtime_error("{}: {}", name_, error.what());
    }
  }

 private:
  // A camera after its first frame.
  struct Mapped {
    CameraPlan plan;
    std::unique_ptr<FrameMapping> mapping;
  };

  Status check_has_sources() const {
    if (source_.files) return {};
    return usage_error("{}: its cameras have no sources; push their frames", name_);
  }

  Status take_cameras(double fps, const LogSink& log) {
    for (const SourceCamera& camera : source_.cameras) {
      if (camera.test && log)
        log(2, fmt::format("camera '{}' is held out (\"test\" in {})", camera.name, name_));
    }
    std::erase_if(source_.cameras, [](const SourceCamera& camera) { return camera.test; });
    if (source_.cameras.size() < 2) {
      return invalid_file("{}: {} that is not held out (expected at least 2)", name_,
                          plural(source_.cameras.size(), "camera"));
    }
    fps_ = fps > 0 ? fps : source_.fps;
    if (fps_ == 0 && !source_.cameras.front().video.empty()) {
      STGS_ASSIGN(const FrameInfo video, probe_frames(*source_.files, source_.cameras.front()));
      fps_ = video.fps;
    }
    if (!(fps_ >= kLiveFps.min && fps_ <= kLiveFps.max)) {
      return usage_error("{}: no usable frame rate (expected {} to {} fps, got {}); set --fps",
                         name_, kLiveFps.min, kLiveFps.max, fps_);
    }
    for (const SourceCamera& camera : source_.cameras) {
      const std::string& recorded =
          camera.video.empty() && !camera.images.empty() ? camera.images.front() : camera.video;
      cameras_.push_back({camera.name, camera.live_source.empty() ? recorded : camera.live_source});
    }
    mapped_.resize(cameras_.size());
    return {};
  }

  Status load(const LogSink& log) {
    try {
      const bool is_file = fs::is_regular_file(name_);
      const fs::path folder = is_file ? fs::absolute(name_).parent_path() : fs::path(name_);
      const std::string file = is_file ? fs::absolute(name_).string() : name_ + "/cameras.json";
      if (!is_file && !fs::exists(file)) {  // a recorded capture, played as if it was filmed
        STGS_ASSIGN(source_, load_source(name_, settings_, {}, log));
        return {};
      }
      STGS_ASSIGN(const auto files, CaptureFolder::open(folder.string(), settings_.allow_outside));
      STGS_ASSIGN(source_, load_rig(files, file));
      source_.has_timing =
          fs::path(file).filename() == "cameras.json" && fs::exists(folder / kTimingFile);
      return {};
    } catch (const fs::filesystem_error& error) {
      return io_error("{}: {}", name_, error.code().message());
    } catch (const std::exception& error) {
      return invalid_file("{}: {}", name_, error.what());
    }
  }

  // Returns the mapping of a camera, which its first frame defines. Thread-safe for different
  // cameras.
  Result<const FrameMapping*> mapping_of(std::size_t camera, cv::Size size) {
    std::unique_ptr<Mapped>& mapped = mapped_[camera];
    if (!mapped) {
      auto made = std::make_unique<Mapped>();
      STGS_ASSIGN(made->plan, plan_camera(source_.cameras[camera],
                                          {size.width, size.height, 0, fps_}, settings_.scale));
      STGS_ASSIGN(made->mapping, FrameMapping::make(made->plan, mapping_device_));
      mapped = std::move(made);
    }
    const FrameInfo& first = mapped->plan.source;
    if (size != cv::Size(first.width, first.height)) {
      return usage_error(
          "camera '{}': a frame differs in size from the first (expected {}x{}, got "
          "{}x{})",
          cameras_[camera].name, first.width, first.height, size.width, size.height);
    }
    return mapped->mapping.get();
  }

  Result<Image8> convert_image(std::size_t camera, const LiveImage& image) {
    STGS_ASSIGN(const FrameMapping* const mapping, mapping_of(camera, {image.width, image.height}));
    const cv::Mat source(image.height, image.width, image.has_alpha ? CV_8UC4 : CV_8UC3,
                         const_cast<std::uint8_t*>(image.data), image.stride);
    STGS_ASSIGN(const cv::Mat mapped, mapping->frame(source));
    if (mapped.channels() == 4)
      return image_of(mapped, image.bgr ? cv::COLOR_BGRA2RGB : cv::COLOR_RGBA2RGB);
    return image_of(mapped, image.bgr ? cv::COLOR_BGR2RGB : kSameOrder);
  }

  // Returns an RGB image. `conversion`: to RGB, of cv::cvtColor.
  static Image8 image_of(const cv::Mat& image, int conversion) {
    Image8 out{image.cols, image.rows, 3, {}};
    out.data.resize(image.total() * 3);
    cv::Mat target(image.size(), CV_8UC3, out.data.data());
    if (conversion == kSameOrder)
      image.copyTo(target);
    else
      cv::cvtColor(image, target, conversion);
    return out;
  }

  const SerialOpenCv serial_;
  const PrepareSettings settings_;
  const std::string name_;
  SourceCapture source_;
  std::vector<LiveCamera> cameras_;
  double fps_ = 0;
  LiveClock clock_;
  VideoDecoding decoding_;
  MappingDevice mapping_device_;
  std::vector<std::unique_ptr<Mapped>> mapped_;  // per camera; null: no frame yet
  std::once_flag started_;
  std::shared_ptr<init::LiveBackgrounds> backgrounds_;
  // Null: on the CPU.
  std::shared_ptr<geometry::MotionFinder> motion_finder_;
  std::shared_ptr<geometry::HullSweeper> sweeper_;
  std::shared_ptr<geometry::VelocityMatcher> velocity_matcher_;
  std::shared_ptr<const StaticFindings> findings_;  // null before the first window
};

}  // namespace

Result<std::unique_ptr<LivePreparer>> LivePreparer::open(const std::string& rig,
                                                         const PrepareSettings& settings,
                                                         double fps, const LogSink& log) {
  const LogSink log_or_none = log ? log : [](int, const std::string&) {};
  auto opened = std::make_unique<Rig>(settings, rig);
  STGS_TRY(opened->open(fps, log_or_none));
  STGS_TRY(opened->choose_backend(log_or_none));
  return std::unique_ptr<LivePreparer>(std::move(opened));
}

Result<std::unique_ptr<LivePreparer>> LivePreparer::open(const std::vector<RigCamera>& cameras,
                                                         const PrepareSettings& settings,
                                                         double fps) {
  auto opened = std::make_unique<Rig>(settings, kGivenRig);
  const Status status = opened->open(cameras, fps);
  // No file is invalid, but the argument is.
  if (!status.ok()) return usage_error("{}", status.message());
  STGS_TRY(opened->choose_backend({}));
  return std::unique_ptr<LivePreparer>(std::move(opened));
}

}  // namespace stgs::encoder
