// SPDX-License-Identifier: Apache-2.0
// The interface of stgs_opencv.so, the only part of the program that uses OpenCV. OpenCV depends on
// some 200 libraries, which take a tenth of a second to load; verbs without OpenCV start without
// them. Program and module are built together and exchange C++ objects.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "stgs/encoder/live_preparer.h"
#include "stgs/encoder/prepare.h"
#include "video.h"

namespace stgs::tools {

// The build that a program or module belongs to.
inline constexpr std::string_view kBuild = STGS_VERSION " " __VERSION__;

struct OpenCvFunctions {
  // Of the module. Checked by the program before anything else.
  std::string_view build = kBuild;
  std::size_t settings_bytes = sizeof(encoder::PrepareSettings);
  // Limits OpenCV's threads (0: no limit) and, if `quiet`, silences its log. Call it once, first.
  void (*set_up)(int threads, bool quiet) = nullptr;
  // Removes the temporary files of the module.
  void (*remove_unfinished)() noexcept = nullptr;
  // As encoder::prepare().
  Status (*prepare)(const std::string& capture, const std::string& folder,
                    const encoder::PrepareSettings& settings, const encoder::ProgressSink& progress,
                    const encoder::LogSink& log) = nullptr;
  // As encoder::WindowPreparer::open().
  Result<std::unique_ptr<encoder::WindowPreparer>> (*open_windows)(
      const std::string& capture, const encoder::PrepareSettings& settings, int window,
      const encoder::ProgressSink& progress, const encoder::LogSink& log) = nullptr;
  // As encoder::LivePreparer::open().
  Result<std::unique_ptr<encoder::LivePreparer>> (*open_live)(
      const std::string& rig, const encoder::PrepareSettings& settings, double fps,
      const encoder::LogSink& log) = nullptr;
  // As make_mp4_writer().
  Result<std::unique_ptr<VideoWriter>> (*make_mp4_writer)(const std::string& path,
                                                          TimeBase time_base,
                                                          const encoder::LogSink& log) = nullptr;
};

// The type of the module's only symbol, STGS_OPENCV_SYMBOL, whose name contains the version.
using OpenCvSymbol = const OpenCvFunctions* (*)();

}  // namespace stgs::tools
