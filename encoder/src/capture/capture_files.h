// SPDX-License-Identifier: Apache-2.0
// What the layouts' loaders share: finding files, and reading small ones whole.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "source_capture.h"

namespace stgs::encoder {

// "cam9" before "cam10": runs of digits compare as numbers.
bool natural_less(const std::string& a, const std::string& b);

bool is_video(const std::string& path);
bool is_picture(const std::string& path);

// Paths in natural order; empty where the folder does not exist.
std::vector<std::string> list_videos(const std::string& folder);
std::vector<std::string> list_pictures(const std::string& folder);
std::vector<std::string> list_folders(const std::string& folder);

// The file's name without folder and extension.
std::string stem_of(const std::string& path);

// Gives `camera` the video folder/NAME.* or the pictures of folder/NAME/ or folder/NAME/images/;
// false where there is none of them.
bool find_frames(const std::string& folder, const std::string& name, SourceCamera& camera);

// The cameras without calibration of a folder: a video each, or a folder of pictures each, in
// videos/, images/ or the folder itself, whichever has any first. Only name and frames are set.
std::vector<SourceCamera> find_cameras(const std::string& folder);

// Gives `camera` its masks, where folder/NAME/ holds pictures: one a frame of the camera, matched
// by name, or, where the camera has a video, in order and numbered from 0 or 1. Returns whether it
// did. Error: a frame without a mask.
Result<bool> find_masks(const std::string& folder, const std::string& name, SourceCamera& camera);

// Puts the folder `made` in the place of `folder`, whose contents are lost only once it is there.
Status replace_folder(const std::string& made, const std::string& folder);

Result<std::vector<std::uint8_t>> read_whole_file(const std::string& path);
Result<nlohmann::json> read_json(const std::string& path);

// Numbers of a nested or flat JSON array, row by row; the error names `what`.
Result<std::vector<double>> json_numbers(const nlohmann::json& json, const std::string& what);

// Sets fx, fy, cx, cy from a row-major 3x3 matrix whose first pixel's centre is at `pixel_centre`.
// Error: skew, or a last row that is not 0 0 1.
Status set_intrinsics(const std::vector<double>& k, double pixel_centre, const std::string& where,
                      SourceCamera& camera);
// From a row-major 3x4 or 4x4 world-to-camera matrix.
Status set_pose(const std::vector<double>& w2c, const std::string& where, SourceCamera& camera);
// From a row-major 3x4 or 4x4 camera-to-world matrix with OpenCV axes.
Status set_pose_from_camera_to_world(const std::vector<double>& c2w, const std::string& where,
                                     SourceCamera& camera);
// Chooses the lens from OpenCV's coefficients; zeros mean a pinhole. Error: a count OpenCV has not.
Status set_distortion(std::vector<double> coefficients, bool fisheye, const std::string& where,
                      SourceCamera& camera);

}  // namespace stgs::encoder
