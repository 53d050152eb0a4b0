// SPDX-License-Identifier: Apache-2.0
// Which moment a picture is of, told by the number that ends its name.
#pragma once

#include "source_capture.h"

namespace stgs::encoder {

// Checks that picture k of every `numbered` camera is of the same moment, for k < end (end < 0: for
// all of a camera's): the numbers of a camera have no gap (one step throughout, so that a capture
// of which every second picture was kept passes) and begin alike in all cameras. Pictures whose
// names end in no number are taken in the order of their names, which is logged. Error: folder,
// camera and the first missing frame.
Status check_frame_numbers(const SourceCapture& source, int end, const LogSink& log);

// Checks that the masks of a video count its frames from 0 or 1, without a gap.
Status check_mask_numbers(const SourceCamera& camera);

}  // namespace stgs::encoder
