// SPDX-License-Identifier: Apache-2.0
// The parts of the program that need OpenCV, which is loaded when the first of them is used. A
// build without OpenCV answers kNotBuilt.
#pragma once

#include <memory>
#include <string>

#include "session.h"
#include "stgs/encoder/live_preparer.h"
#include "stgs/encoder/prepare.h"

namespace stgs::tools {

// Sets the number of threads that OpenCV will use, and silences it and FFmpeg, which print to
// standard error, unless --log-level is debug. Call it before any thread starts: it changes the
// environment.
void set_up_opencv(const CommonOptions& options);

// As encoder::prepare().
Status prepare_capture(const std::string& capture, const std::string& folder,
                       const encoder::PrepareSettings& settings, Session& session);

// As encoder::WindowPreparer::open().
Result<std::unique_ptr<encoder::WindowPreparer>> open_windows(
    const std::string& capture, const encoder::PrepareSettings& settings, int window,
    Session& session);

// As encoder::LivePreparer::open().
Result<std::unique_ptr<encoder::LivePreparer>> open_live(const std::string& rig,
                                                         const encoder::PrepareSettings& settings,
                                                         double fps, Session& session);

}  // namespace stgs::tools
