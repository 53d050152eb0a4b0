// SPDX-License-Identifier: Apache-2.0
#include "opencv.h"

#include <cstdlib>
#include <string>

#include "end_after_signal.h"
#include "opencv_module.h"
#include "standard_streams.h"
#include "stgs/encoder/image_file.h"
#include "stgs/encoder/program_module.h"

namespace stgs::tools {

#ifdef STGS_HAS_PREPARE
namespace {

#define STGS_TEXT_OF(name) #name
#define STGS_TEXT(name) STGS_TEXT_OF(name)
constexpr const char* kModule = "stgs_opencv.so";
constexpr const char* kSymbol = STGS_TEXT(STGS_OPENCV_SYMBOL);

struct OpenCvSettings {
  int threads = 0;
  bool quiet = true;
};

OpenCvSettings& settings_of_process() {
  static OpenCvSettings settings;
  return settings;
}

Result<const OpenCvFunctions*> load() {
  STGS_ASSIGN(void* const symbol, encoder::load_program_module(kModule, kSymbol, false));
  const OpenCvFunctions* const functions = reinterpret_cast<OpenCvSymbol>(symbol)();
  const OpenCvFunctions own;
  if (functions->build != own.build || functions->settings_bytes != own.settings_bytes) {
    return unsupported("{}: belongs to another build of stgs; reinstall it", kModule);
  }
  return functions;
}

// Loads OpenCV on the first call.
Result<const OpenCvFunctions*> opencv() {
  static const Result<const OpenCvFunctions*> loaded = [] {
    Result<const OpenCvFunctions*> functions = load();
    const OpenCvSettings& settings = settings_of_process();
    if (functions.ok()) {
      (*functions)->set_up(settings.threads, settings.quiet);
      end_of_module((*functions)->remove_unfinished);
    }
    if (settings.quiet) silence_libraries();
    return functions;
  }();
  return loaded;
}

}  // namespace

void set_up_opencv(const CommonOptions& options) {
  settings_of_process() = {options.threads, options.log_level != "debug"};
  // OpenCV reads it when it first opens a video; -8 is AV_LOG_QUIET. A value set by the user stays.
  if (options.log_level != "debug") ::setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);
  // OpenCV reads it when it is loaded. The encoder checks the size that the header states before.
  ::setenv("OPENCV_IO_MAX_IMAGE_PIXELS", std::to_string(encoder::kMaxImagePixels).c_str(), 0);
}

Status prepare_capture(const std::string& capture, const std::string& folder,
                       const encoder::PrepareSettings& settings, Session& session) {
  STGS_ASSIGN(const OpenCvFunctions* const functions, opencv());
  const EndAfterSignal end(session, folder + ": not written");
  return functions->prepare(capture, folder, settings, session.progress_sink(), session.log_sink());
}

Result<std::unique_ptr<encoder::WindowPreparer>> open_windows(
    const std::string& capture, const encoder::PrepareSettings& settings, int window,
    Session& session) {
  STGS_ASSIGN(const OpenCvFunctions* const functions, opencv());
  const EndAfterSignal end(session, capture + ": not read");
  return functions->open_windows(capture, settings, window, session.progress_sink(),
                                 session.log_sink());
}

Result<std::unique_ptr<encoder::LivePreparer>> open_live(const std::string& rig,
                                                         const encoder::PrepareSettings& settings,
                                                         double fps, Session& session) {
  STGS_ASSIGN(const OpenCvFunctions* const functions, opencv());
  return functions->open_live(rig, settings, fps, session.log_sink());
}

Status check_mp4_writer() {
  return opencv().status();
}

Result<std::unique_ptr<VideoWriter>> make_mp4_writer(const std::string& path, TimeBase time_base,
                                                     const encoder::LogSink& log) {
  STGS_ASSIGN(const OpenCvFunctions* const functions, opencv());
  return functions->make_mp4_writer(path, time_base, log);
}

#else

void set_up_opencv(const CommonOptions&) {}

Status prepare_capture(const std::string& capture, const std::string&,
                       const encoder::PrepareSettings&, Session&) {
  return not_built(
      "{}: this build cannot prepare captures (no OpenCV or FFmpeg); rebuild with the packages of "
      "tools/setup/packages.txt and STGS_WITH_PREPARE=ON, or prepare on another machine",
      capture);
}

Result<std::unique_ptr<encoder::WindowPreparer>> open_windows(
    const std::string& capture, const encoder::PrepareSettings& settings, int, Session& session) {
  return prepare_capture(capture, "", settings, session);
}

Result<std::unique_ptr<encoder::LivePreparer>> open_live(const std::string& rig,
                                                         const encoder::PrepareSettings& settings,
                                                         double, Session& session) {
  return prepare_capture(rig, "", settings, session);
}

Status check_mp4_writer() {
  return not_built(
      "this build has no mp4, because OpenCV or FFmpeg was not found; rebuild with the packages of "
      "tools/setup/packages.txt");
}

Result<std::unique_ptr<VideoWriter>> make_mp4_writer(const std::string& path, TimeBase,
                                                     const encoder::LogSink&) {
  const Status missing = check_mp4_writer();
  return Status(missing.code(), fmt::format("{}: {}, or write .y4m", path, missing.message()));
}

#endif

}  // namespace stgs::tools
