// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/prepare.h"

#include <unistd.h>
#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>
#include <vector>

#include "capture_files.h"
#include "geometry/view_matcher.h"
#include "init/static_findings.h"
#include "init_settings.h"
#include "plural.h"
#include "rig_file.h"
#include "serial_opencv.h"
#include "source_capture.h"
#include "stgs/encoder/camera_json.h"
#include "stgs/encoder/frame_memory.h"
#include "stgs/format/output_path.h"
#include "stgs/format/temporary.h"
#include "train/machine_memory.h"
#include "write_frames.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

constexpr double kMemoryShare = 1.0 / 3;  // of the available memory, for the frames of a window
constexpr double kDefaultWindowSeconds = 2;

// Creates the missing parents of a path. The destructor deletes each of them that is empty.
class Parents {
 public:
  explicit Parents(const std::string& path) {
    const fs::path parent = fs::absolute(path).parent_path();
    for (fs::path above = parent; !fs::exists(above); above = above.parent_path()) {
      created_.push_back(above);
    }
    fs::create_directories(parent, error_);
  }
  ~Parents() {
    for (const fs::path& above : created_) ::rmdir(above.c_str());
  }
  Parents(const Parents&) = delete;
  Parents& operator=(const Parents&) = delete;

  // kIo if a parent could not be created. The message names `path`.
  Status created(const std::string& path) const {
    if (!error_) return {};
    return io_error("{}: cannot create: {}", path, error_.message());
  }

 private:
  std::error_code error_;
  std::vector<fs::path> created_;  // innermost first
};

Status check(const PrepareSettings& settings) {
  STGS_TRY(check_parameters<PrepareParameters>(settings));
  if (settings.first_frame < 0 ||
      (settings.end_frame >= 0 && settings.end_frame <= settings.first_frame)) {
    return usage_error("frames {}:{} are not a range (expected FIRST:END with 0 <= FIRST < END)",
                       settings.first_frame, settings.end_frame);
  }
  return {};
}

// Also reports an unavailable backend or video decoder, even if the capture turns out to need none.
Status check_all(const PrepareSettings& settings) {
  STGS_TRY(check(settings));
  STGS_TRY(choose_video_decoding(settings, 0, {}).status());
  return settings.backend == "auto"
             ? Status()
             : geometry::make_matcher(settings.backend, settings.share.index, {}).status();
}

// Allows replacing a prepared capture or an empty folder, but never the source capture.
Status check_target(const std::string& capture, const std::string& folder, bool overwrite) {
  const fs::path target = fs::weakly_canonical(folder), source = fs::weakly_canonical(capture);
  const fs::path relative = source.lexically_relative(target);
  if (!relative.empty() && *relative.begin() != "..") {
    return usage_error(
        "{}: the output folder is the capture or contains it; name another output folder", folder);
  }
  if (!fs::exists(folder)) return {};
  if (fs::is_directory(folder) && fs::is_empty(folder)) return {};
  if (!fs::exists(folder + "/capture.json")) {
    return usage_error("{}: exists and is not a prepared capture; name another output folder",
                       folder);
  }
  if (!overwrite) {
    return usage_error("{}: exists; name another output folder, or replace it with --overwrite",
                       folder);
  }
  return {};
}

InitSettings init_settings(const std::string& capture, const SourceCapture& source,
                           const PrepareSettings& settings) {
  InitSettings init = init_settings(capture, settings);
  init.flow_folder = source.flow_folder;
  init.flow_files = source.files;
  init.points = source.points;
  return init;
}

// Runs `task` with a work folder, whose folder "prepared" then becomes the target. First takes the
// lock of the target and removes the work folders of killed runs.
Status guarded_by_target(const std::string& capture, const std::string& folder, bool overwrite,
                         const LogSink& log,
                         const std::function<Status(const std::string& work)>& task) {
  try {
    const SerialOpenCv serial;
    const std::string target = (fs::path(folder) / "").parent_path().string();
    STGS_TRY(check_target(capture, target, overwrite));
    const Parents parents(target);
    STGS_TRY(parents.created(target));
    OutputLock lock;
    STGS_TRY(lock.take(target));
    // Again: before the lock was taken another prepare may have finished.
    STGS_TRY(check_target(capture, target, overwrite));
    clear_leftovers(target, log);
    WorkFolder work;
    STGS_TRY(work.create(target));
    STGS_TRY(task(work.path()));
    return replace_folder(work.path() + "/prepared", target, overwrite);
  } catch (const fs::filesystem_error& error) {
    return io_error("{}: {}", error.path1().string(), error.code().message());
  } catch (const std::exception& error) {
    return runtime_error("{}: {}", capture, error.what());
  }
}

class Preparer final : public WindowPreparer {
 public:
  Preparer(std::string capture, PrepareSettings settings)
      : capture_(std::move(capture)), settings_(std::move(settings)) {}

  Status open(int window, const ProgressSink& progress, const LogSink& log) {
    STGS_ASSIGN(source_, load_source(capture_, settings_, progress, log));
    complete_.source = layout_name(source_.layout);
    complete_.metric = source_.metric;
    STGS_ASSIGN(plans_, plan_frames(source_, settings_, complete_, log));
    log(2, fmt::format("{}: {}, frames {}:{}", capture_, plural(complete_.cameras.size(), "camera"),
                       complete_.first_frame, complete_.first_frame + complete_.frames));
    const bool is_default = window == kDefaultWindow;
    windows_ = cut_into_windows(
        complete_.frames,
        is_default ? default_window(complete_.frames, complete_.time_base) : window);
    if (windows_.size() > 1 && !settings_.separate_motion) {
      return usage_error(
          "{}: windows need dynamic points, which --no-split disables; remove it, or encode all {} "
          "frames at once with --window 0",
          capture_, complete_.frames);
    }
    return settings_.accept ? settings_.accept(complete_) : Status();
  }

  const std::vector<FrameSpan>& windows() const override { return windows_; }

  Result<std::string> identity() const override {
    std::string out = fmt::format(
        "layout {}\nfps {}\nbackend {}\nseed {}\npoints {} {}\ntrusted {}\nframes {}:{}\nwindows "
        "{}, "
        "the first of {}\n",
        layout_name(source_.layout), complete_.time_base.seconds(1), settings_.backend,
        settings_.seed, settings_.max_static_points, settings_.max_dynamic_points,
        settings_.trust_calibration, complete_.first_frame,
        complete_.first_frame + complete_.frames, windows_.size(), windows_.front().size());
    for (const Camera& camera : complete_.cameras)
      out += camera_to_json(camera).dump() + (camera.test ? " test\n" : "\n");
    for (const SourceCamera& camera : source_.cameras) {
      if (!camera.video.empty()) STGS_TRY(add_version(camera.video, out));
      for (const std::string& image : camera.images) STGS_TRY(add_version(image, out));
      for (const std::string& mask : camera.masks) STGS_TRY(add_version(mask, out));
    }
    // A hash, because the text names every image.
    return fmt::format("capture {:016x}\n", XXH3_64bits(out.data(), out.size()));
  }

  void keep_analysis(const std::string& path) override { findings_path_ = path; }

  Result<PreparedCapture> prepare(std::size_t index, const std::string& folder, bool files,
                                  const ProgressSink& progress, const LogSink& log) override {
    const LogSink log_or_none = log ? log : [](int, const std::string&) {};
    PreparedCapture window;
    const Status prepared = guarded_by_target(
        capture_, folder, settings_.overwrite, log_or_none, [&](const std::string& work) -> Status {
          if (index > 0 && !findings_)
            STGS_TRY(find_findings(work + "/first", files, progress, log_or_none));
          STGS_ASSIGN(window,
                      prepare_window(index, work + "/prepared", files, progress, log_or_none));
          return {};
        });
    STGS_TRY(prepared);
    window.folder = folder;
    STGS_ASSIGN(window.files, CaptureFolder::open(folder, false));
    return window;
  }

  // Prepares a window into a new folder, without a guard.
  Result<PreparedCapture> prepare_window(std::size_t index, const std::string& folder, bool files,
                                         const ProgressSink& progress, const LogSink& log) {
    fs::create_directory(folder);
    PreparedCapture window = complete_;
    window.folder = folder;
    window.first_frame += windows_[index].begin;
    window.frames = windows_[index].size();
    const auto bytes = double(FrameMemory::bytes_of(window.cameras, window.frames));
    if (bytes <= kMemoryShare * double(available_memory()) / settings_.share.processes) {
      window.memory = std::make_shared<FrameMemory>();
      window.memory_only = !files;
    }
    STGS_TRY(write_all_frames(window, index, progress, log));
    InitSettings init = init_settings(capture_, source_, settings_);
    init.write_report = files;
    if (index == 0) {
      STGS_TRY(initialise(window, init, progress, log, &findings_));
      STGS_TRY(store_findings());
    } else {
      STGS_TRY(initialise_later(window, init, *findings_, progress, log));
    }
    if (files) {
      const double fps = 1 / complete_.time_base.seconds(1);
      STGS_TRY(write_rig(source_, plans_, fps, folder + "/rig.json"));
    }
    STGS_TRY(write_prepared_capture(window));
    return window;
  }

 private:
  // Returns the pixels in all frames that are decoded of the longest video; 0 without a video.
  std::int64_t pixels_of_longest_video() const {
    std::int64_t most = 0;
    for (std::size_t i = 0; i < plans_.size(); ++i) {
      const FrameInfo& frame = plans_[i].source;
      if (source_.cameras[i].video.empty()) continue;
      most = std::max(most, std::int64_t{frame.width} * frame.height * complete_.frames);
    }
    return most;
  }

  Status write_all_frames(const PreparedCapture& window, std::size_t index,
                          const ProgressSink& progress, const LogSink& log) {
    const bool is_first = videos_.videos.empty();
    const std::int64_t pixels = pixels_of_longest_video();
    const bool has_videos = pixels > 0;
    const bool has_changes =
        has_videos || std::any_of(plans_.begin(), plans_.end(),
                                  [](const CameraPlan& plan) { return !plan.is_identity(); });
    if (is_first && has_videos) {
      STGS_ASSIGN(videos_.decoding, choose_video_decoding(settings_, pixels, log));
    }
    if (is_first && has_changes) {
      STGS_ASSIGN(videos_.mapping_device, choose_mapping_device(settings_, log));
    }
    STGS_TRY(write_frames(source_, plans_, window, videos_, progress));
    if (is_first) log_decoders(source_, videos_, log);
    // Decoders hold memory of the GPU.
    if (index + 1 == windows_.size()) videos_ = {};
    return {};
  }

  // Reads the findings in the first window, or analyses it again in a new folder, which it removes.
  Status find_findings(const std::string& folder, bool files, const ProgressSink& progress,
                       const LogSink& log) {
    if (!findings_path_.empty() && fs::exists(findings_path_)) {
      STGS_ASSIGN(const std::string text, identity());
      STGS_ASSIGN(StaticFindings read, read_findings(findings_path_, text));
      findings_ = std::make_shared<const StaticFindings>(std::move(read));
      return {};
    }
    log(2, fmt::format("{}: analysing the first window again", capture_));
    STGS_TRY(prepare_window(0, folder, files, progress, log).status());
    fs::remove_all(folder);
    return {};
  }

  Status store_findings() const {
    if (findings_path_.empty()) return {};
    STGS_ASSIGN(const std::string text, identity());
    return write_findings(findings_path_, text, *findings_);
  }

  // Adds the path, the size and the time of the last change of a file.
  Status add_version(const std::string& path, std::string& out) const {
    STGS_ASSIGN(const CaptureFile file, source_.files->open_file(path));
    STGS_ASSIGN(const FileVersion version, file.version(path));
    out += fmt::format("{} {} {}.{}\n", path, version.bytes, version.seconds, version.nanoseconds);
    return {};
  }

  const std::string capture_;
  const PrepareSettings settings_;
  SourceCapture source_;
  PreparedCapture complete_;  // without bounds
  std::vector<CameraPlan> plans_;
  std::vector<FrameSpan> windows_;
  OpenVideos videos_;
  std::shared_ptr<const StaticFindings> findings_;  // of the first window
  std::string findings_path_;                       // "": they are kept in memory alone
};

}  // namespace

int default_window(int frames, const TimeBase& time_base) {
  if (frames <= kMaxFramesAtOnce) return 0;
  const double ticks = std::min(time_base.ticks(kDefaultWindowSeconds), double(kMaxFramesAtOnce));
  return std::max(kMinWindowFrames, int(std::lround(ticks)));
}

std::vector<FrameSpan> cut_into_windows(int frames, int length) {
  std::vector<FrameSpan> out;
  for (int begin = 0; begin < frames;) {
    const int rest = frames - begin;
    const int size = length == 0 || rest < length + (length + 1) / 2 ? rest : length;
    out.push_back({begin, begin + size});
    begin += size;
  }
  return out;
}

Result<std::unique_ptr<WindowPreparer>> WindowPreparer::open(const std::string& capture,
                                                             const PrepareSettings& settings,
                                                             int window,
                                                             const ProgressSink& progress,
                                                             const LogSink& log) {
  STGS_TRY(check_all(settings));
  const LogSink log_or_none = log ? log : [](int, const std::string&) {};
  try {
    const SerialOpenCv serial;
    auto preparer = std::make_unique<Preparer>(capture, settings);
    STGS_TRY(preparer->open(window, progress, log_or_none));
    return std::unique_ptr<WindowPreparer>(std::move(preparer));
  } catch (const fs::filesystem_error& error) {
    return io_error("{}: {}", error.path1().string(), error.code().message());
  } catch (const std::exception& error) {
    return runtime_error("{}: {}", capture, error.what());
  }
}

Status prepare(const std::string& capture, const std::string& folder,
               const PrepareSettings& settings, const ProgressSink& progress, const LogSink& log) {
  STGS_TRY(check_all(settings));
  const LogSink log_or_none = log ? log : [](int, const std::string&) {};
  Preparer preparer(capture, settings);
  return guarded_by_target(
      capture, folder, settings.overwrite, log_or_none, [&](const std::string& work) -> Status {
        STGS_TRY(preparer.open(0, progress, log_or_none));
        return preparer.prepare_window(0, work + "/prepared", true, progress, log_or_none).status();
      });
}

}  // namespace stgs::encoder
