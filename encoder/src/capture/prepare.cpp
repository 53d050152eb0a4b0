// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/prepare.h"

#include <unistd.h>

#include <filesystem>
#include <opencv2/core/utility.hpp>
#include <utility>
#include <vector>

#include "capture_files.h"
#include "geometry/view_matcher.h"
#include "init/init.h"
#include "plural.h"
#include "source_capture.h"
#include "stgs/format/output_path.h"
#include "stgs/format/temporary.h"
#include "write_frames.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

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

Status prepare_into(const std::string& capture, const std::string& folder,
                    const PrepareSettings& settings, const ProgressSink& progress,
                    const LogSink& log) {
  STGS_ASSIGN(const SourceCapture source, load_source(capture, settings, progress, log));
  PreparedCapture prepared;
  prepared.folder = folder;
  prepared.source = layout_name(source.layout);
  prepared.metric = source.metric;
  STGS_ASSIGN(const std::vector<CameraPlan> plans, plan_frames(source, settings, prepared, log));
  log(2, fmt::format("{}: {}, frames {}:{}", capture, plural(prepared.cameras.size(), "camera"),
                     prepared.first_frame, prepared.first_frame + prepared.frames));
  if (settings.accept) STGS_TRY(settings.accept(prepared));
  STGS_TRY(write_frames(source, plans, prepared, progress));
  InitSettings init;
  init.name = capture;
  init.trust_calibration = settings.trust_calibration;
  init.separate_motion = settings.separate_motion;
  init.max_dynamic_points = settings.max_dynamic_points;
  init.max_static_points = settings.max_static_points;
  init.seed = settings.seed;
  init.backend = settings.backend;
  init.flow_folder = source.flow_folder;
  init.flow_files = source.files;
  init.points = source.points;
  STGS_TRY(initialise(prepared, init, progress, log));
  return write_prepared_capture(prepared);
}

// Makes OpenCV single-threaded in the whole process: our loops around its calls use all threads.
class SerialOpenCv {
 public:
  SerialOpenCv() : before_(cv::getNumThreads()) { cv::setNumThreads(1); }
  ~SerialOpenCv() { cv::setNumThreads(before_); }
  SerialOpenCv(const SerialOpenCv&) = delete;
  SerialOpenCv& operator=(const SerialOpenCv&) = delete;

 private:
  const int before_;
};

}  // namespace

Status prepare(const std::string& capture, const std::string& folder,
               const PrepareSettings& settings, const ProgressSink& progress, const LogSink& log) {
  STGS_TRY(check(settings));
  // Report an unavailable backend now, even if the rig turns out to need no stereo.
  if (settings.backend != "auto") STGS_TRY(geometry::make_matcher(settings.backend, {}).status());
  const LogSink log_or_none = log ? log : [](int, const std::string&) {};
  try {
    const SerialOpenCv serial;
    const std::string target = (fs::path(folder) / "").parent_path().string();
    STGS_TRY(check_target(capture, target, settings.overwrite));
    const Parents parents(target);
    STGS_TRY(parents.created(target));
    OutputLock lock;
    STGS_TRY(lock.take(target));
    // Again: before the lock was taken another prepare may have finished.
    STGS_TRY(check_target(capture, target, settings.overwrite));
    clear_leftovers(target, log_or_none);
    WorkFolder work;
    STGS_TRY(work.create(target));
    const std::string made = work.path() + "/prepared";
    fs::create_directory(made);
    STGS_TRY(prepare_into(capture, made, settings, progress, log_or_none));
    return replace_folder(made, target, settings.overwrite);
  } catch (const fs::filesystem_error& error) {
    return io_error("{}: {}", error.path1().string(), error.code().message());
  } catch (const std::exception& error) {
    return runtime_error("{}: {}", capture, error.what());
  }
}

}  // namespace stgs::encoder
