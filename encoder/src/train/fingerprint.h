// SPDX-License-Identifier: Apache-2.0
// Everything that resuming a run depends on, so that only the same run resumes a checkpoint.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/train.h"
#include "stgs/format/status.h"
#include "train/hyper_parameters.h"

namespace stgs::encoder {

// Names with their values; names are unique.
using Fingerprint = std::vector<std::pair<std::string, std::string>>;

// The entry of the backend. Another backend resumes to a scene of equal quality, but not to the
// same bits, so a difference is logged and not an error.
inline constexpr const char* kBackendEntry = "backend";
// The same for the number of processes that train together.
inline constexpr const char* kProcessesEntry = "processes";

// Returns the entries known before the capture is: settings and hyper-parameters.
Fingerprint fingerprint_of(const HyperParameters& parameters, const TrainSettings& settings);
// Returns the entries of the training cameras, the frames and the bounds.
Fingerprint fingerprint_of(const PreparedCapture& capture);

// Returns the entries of the training cameras' image files as they are now; one stat() per file.
Fingerprint image_fingerprint(const PreparedCapture& capture);

// Converts to and from the text that a checkpoint stores. The error does not name the file.
std::string fingerprint_text(const Fingerprint& fingerprint);
Result<Fingerprint> read_fingerprint(const std::string& text);

// Returns the value of an entry; "" if it is missing.
std::string value_of(const Fingerprint& fingerprint, const std::string& name);

// Checks that every entry of `now` has the same value in `found`. kUsage lists the entries that
// differ or are missing, with both values. Ignores kBackendEntry and kProcessesEntry. `path` is the
// checkpoint's, for the message.
Status check_same_run(const std::string& path, const Fingerprint& found, const Fingerprint& now);

}  // namespace stgs::encoder
