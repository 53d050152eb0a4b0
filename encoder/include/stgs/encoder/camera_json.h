// SPDX-License-Identifier: Apache-2.0
// JSON form of a camera: an entry of "cameras" in capture.json, or a file of its own.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// Limits of a camera's timing: of the absolute value of its time offset, in seconds, and of its
// frame rate.
inline constexpr double kMaxTimeOffset = 1e6, kMinFps = 0.001, kMaxFps = 1e5;

// Converts JSON to a camera and validates it. "name", "test", "time_offset" and "fps" are optional.
// kInvalidFile names `where` (a file), the camera and the key.
Result<Camera> camera_from_json(const nlohmann::json& json, const std::string& where);
// Converts a camera to JSON with every key that camera_from_json reads, except a time offset or
// frame rate of 0.
nlohmann::ordered_json camera_to_json(const Camera& camera);

// Reads a camera file: a camera, or an object with the key "start_camera", such as the output of
// 'stgs info --format json'. kInvalidFile names `where` (the file); also if that key is null.
Result<Camera> parse_camera(std::string_view text, const std::string& where);

// Validates size, intrinsics, pose (in single precision) and timing. kInvalidFile names `where` (a
// file).
Status check_camera(const Camera& camera, const std::string& where);

}  // namespace stgs::encoder
