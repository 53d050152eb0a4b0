// SPDX-License-Identifier: Apache-2.0
// Tiny captures of every layout.
#pragma once

#include <vector>

#include "packed_files.h"

namespace stgs::fuzz {

inline constexpr int kSeedWidth = 8, kSeedHeight = 6, kSeedFrames = 2;

// Each layout with two to four cameras; images are of kSeedWidth x kSeedHeight pixels.
std::vector<PackedFiles> capture_seeds();

// Models of COLMAP of two cameras, below sparse/0/.
std::vector<PackedFile> colmap_text_model();
std::vector<PackedFile> colmap_binary_model();

// Calibrations of two cameras "a" and "b".
std::string toml_calibration();
std::string qualisys_calibration();
// In the formats of OpenCV, of one camera.
std::string yaml_calibration(int camera);
std::string json_calibration(int camera);
std::string xml_calibration(int camera);

}  // namespace stgs::fuzz
