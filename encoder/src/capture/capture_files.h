// SPDX-License-Identifier: Apache-2.0
// Helpers shared by the layout loaders: finding files, reading JSON, setting camera parameters.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "source_capture.h"
#include "stgs/encoder/capture_folder.h"

namespace stgs::encoder {

// Decide by the file extension, in any case.
bool is_video(const std::string& path);
bool is_image(const std::string& path);

// Return paths in natural order, without hidden files. Empty if the folder does not exist. Links to
// the outside are included: opening them is an error.
Result<std::vector<std::string>> list_videos(const CaptureFolder& files, const std::string& folder);
Result<std::vector<std::string>> list_images(const CaptureFolder& files, const std::string& folder);
Result<std::vector<std::string>> list_folders(const CaptureFolder& files,
                                              const std::string& folder);
Result<std::vector<std::string>> list_files(const CaptureFolder& files, const std::string& folder);

// Returns the file name without folder and extension.
std::string stem_of(const std::string& path);

// Sets the frames of `camera` to the video folder/NAME.* or to the images in folder/NAME/ or
// folder/NAME/images/. Returns false if there are none.
Result<bool> find_frames(const CaptureFolder& files, const std::string& folder,
                         const std::string& name, SourceCamera& camera);

// Returns the uncalibrated cameras of a capture, one for each video or image folder. Searches
// videos/, images/ and the folder itself, and stops at the first that has any. Sets name and
// frames.
Result<std::vector<SourceCamera>> find_cameras(const CaptureFolder& files);

// Sets the masks of `camera` to the images in folder/NAME/ and returns true if there are any. Masks
// match image frames by file name. For a video they are numbered from 0 or 1, without gaps.
// kIo for a frame without a mask.
Result<bool> find_masks(const CaptureFolder& files, const std::string& folder,
                        const std::string& name, SourceCamera& camera);

// Moves the folder `made` to `folder`. With `overwrite`, a folder that is not empty is then at
// `made` or `made`.old, for the caller to delete; without it that is an error.
Status replace_folder(const std::string& made, const std::string& folder, bool overwrite);

// Reads a table or calibration, of at most kCaptureLimits.table_bytes.
Result<std::vector<std::uint8_t>> read_table(const CaptureFolder& files, const std::string& path);
// Reads and parses a JSON file. kInvalidFile for a syntax error.
Result<nlohmann::json> read_json(const CaptureFolder& files, const std::string& path);

// Flattens a nested or flat JSON array of finite numbers, row by row. The error names `what`.
Result<std::vector<double>> json_numbers(const nlohmann::json& json, const std::string& what);

// Sets fx, fy, cx and cy from a row-major 3x3 matrix. `pixel_centre` is the coordinate of the
// first pixel's centre in the convention of the matrix: 0 or 0.5. kInvalidFile for a number that is
// not finite, kUnsupported for skew or a last row other than 0 0 1.
Status set_intrinsics(const std::vector<double>& k, double pixel_centre, const std::string& where,
                      SourceCamera& camera);
// Sets the pose from a row-major 3x4 or 4x4 world-to-camera matrix.
Status set_pose(const std::vector<double>& w2c, const std::string& where, SourceCamera& camera);
// Sets the pose from a row-major 3x4 or 4x4 camera-to-world matrix with OpenCV axes.
Status set_pose_from_camera_to_world(const std::vector<double>& c2w, const std::string& where,
                                     SourceCamera& camera);
// Sets the size that the intrinsics are for. kInvalidFile unless both sides are 1 to kMaxImageSide
// pixels.
Status set_size(double width, double height, const std::string& where, SourceCamera& camera);
// Sets the lens model from OpenCV coefficients: kPinhole if all are zero. kInvalidFile for a number
// of coefficients that the model does not have, or one that is not finite.
Status set_distortion(std::vector<double> coefficients, bool fisheye, const std::string& where,
                      SourceCamera& camera);

}  // namespace stgs::encoder
