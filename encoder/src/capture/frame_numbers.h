// SPDX-License-Identifier: Apache-2.0
// Checks that cameras are synchronised, by the frame numbers that end the image file names.
#pragma once

#include "source_capture.h"

namespace stgs::encoder {

// Checks that image k of every `numbered` camera has the same frame number, for k < end (all images
// if end < 0). The numbers start at the same value in all cameras and have no gaps. Any constant
// step is accepted, so a capture reduced to every second frame passes. Images without numbers are
// used in the order of their names, with a warning. kInvalidFile names folder, camera and the first
// missing frame.
Status check_frame_numbers(const SourceCapture& source, int end, const LogSink& log);

// Checks that the masks of a video are numbered from 0 or 1, without gaps.
Status check_mask_numbers(const SourceCamera& camera);

}  // namespace stgs::encoder
