// SPDX-License-Identifier: Apache-2.0
// encode for long captures, in windows of time, which several processes train in parallel.
#pragma once

#include <string>

#include "session.h"
#include "stgs/encoder/prepare.h"
#include "stgs/encoder/stream_encoder.h"

namespace stgs::tools {

// Encodes the windows of a capture into `output`, with all processes of the session, which make the
// same call. Works in the folder `work`, which stays if the run is interrupted: the same run then
// continues after the last complete window. At the end it is removed unless `keep_work`. The first
// process prints the result of 'encode'.
Status encode_windows(encoder::WindowPreparer& preparer, const encoder::StreamSettings& settings,
                      const std::string& work, bool keep_work, const std::string& output,
                      Session& session);

}  // namespace stgs::tools
