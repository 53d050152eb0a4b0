// SPDX-License-Identifier: Apache-2.0
// A camera as JSON: an entry of capture.json's "cameras", and a file of its own.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// Name and test may be missing. The error names `where` (a file) and the camera.
Result<Camera> camera_from_json(const nlohmann::ordered_json& json, const std::string& where);
nlohmann::ordered_json camera_to_json(const Camera& camera);

// kInvalidFile where its size, intrinsics or pose make no sense.
Status check_camera(const Camera& camera, const std::string& where);

}  // namespace stgs::encoder
