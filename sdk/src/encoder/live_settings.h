// SPDX-License-Identifier: Apache-2.0
// The structs of stgs_encoder_live.h: their defaults, checks and conversions.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "encoder/encoder.h"
#include "stgs/encoder/live_encoder.h"

namespace stgs::sdk {

stgs_live_camera default_live_camera();
stgs_live_settings default_live_settings();
stgs_live_image default_live_image();

Outcome check(const stgs_live_settings& settings);
// Sets `stride` to its value if it is 0.
Outcome check(stgs_live_image& image);

// Opens the rig of settings that have been checked. STGS_ERROR_NOT_BUILT without OpenCV or FFmpeg.
Outcome open_rig(const stgs_live_settings& settings, const encoder::LogSink& log,
                 std::unique_ptr<encoder::LivePreparer>& out);
// Converts settings that have been checked. Does not set `tasks`.
encoder::LiveSettings live_encoding_of(const stgs_live_settings& settings,
                                       const std::string& recording);

stgs_live_window to_c(const encoder::LiveWindow& window);
stgs_live_report to_c(const encoder::LiveReport& report, bool ended);

// Returns the bytes of a pixel.
std::size_t pixel_bytes(stgs_pixel_format format);

}  // namespace stgs::sdk
