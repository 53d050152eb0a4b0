// SPDX-License-Identifier: Apache-2.0
// JSON form of a camera: an entry of "cameras" in capture.json, or a file of its own.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// Converts JSON to a camera and validates it. "name" and "test" are optional.
// kInvalidFile names `where` (a file), the camera and the key.
Result<Camera> camera_from_json(const nlohmann::json& json, const std::string& where);
// Converts a camera to JSON with every key that camera_from_json reads.
nlohmann::ordered_json camera_to_json(const Camera& camera);

// Reads a camera file: a camera, or an object with the key "start_camera", such as the output of
// 'stgs info --format json'. kInvalidFile names `where` (the file); also if that key is null.
Result<Camera> parse_camera(std::string_view text, const std::string& where);

// Validates size, intrinsics and pose in single precision. kInvalidFile names `where` (a file).
Status check_camera(const Camera& camera, const std::string& where);

}  // namespace stgs::encoder
