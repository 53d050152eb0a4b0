// SPDX-License-Identifier: Apache-2.0
#pragma once

struct AVStream;

namespace stgs::encoder {

// Returns the clockwise rotation that a video track states, as a code of cv::rotate(); -1: none.
int rotation_of(const AVStream& stream);

}  // namespace stgs::encoder
