// SPDX-License-Identifier: Apache-2.0
// Estimates the space that is empty, from the initial points: in front of the training cameras of a
// sparse rig, and in front of cameras between them, nearer than the scene. Primitives there hide
// the scene from views that no image constrains, so densification removes them.
#pragma once

#include "stgs/encoder/prepared_capture.h"
#include "train/densify_rules.h"

namespace stgs::encoder {

// Returns the free space of a capture, from its initial points; empty for a rig that is not sparse
// (rig.h). The error is that of reading the points.
Result<FreeSpace> find_free_space(const PreparedCapture& capture);

// Returns a hash of the free space, for fingerprints.
std::string fingerprint_of(const FreeSpace& space);

}  // namespace stgs::encoder
