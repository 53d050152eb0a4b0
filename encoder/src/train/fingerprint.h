// SPDX-License-Identifier: Apache-2.0
// What a run's continuation depends on, so that a checkpoint is resumed by its own run alone.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/train.h"
#include "stgs/format/status.h"
#include "train/hyper_parameters.h"

namespace stgs::encoder {

// Names with their values; no name twice.
using Fingerprint = std::vector<std::pair<std::string, std::string>>;

// The entry of what trains. Another backend goes on to a scene as good, not to the same bits, so it
// is told of and not refused.
inline constexpr const char* kBackendEntry = "backend";
// The same of the number of processes that train together.
inline constexpr const char* kProcessesEntry = "processes";

// The part that is known before the capture is.
Fingerprint fingerprint_of(const HyperParameters& parameters, const TrainSettings& settings);
// Of the training cameras, the frames and the bounds.
Fingerprint fingerprint_of(const PreparedCapture& capture);

// Of the training cameras' pictures, as they are now: a stat a file.
Fingerprint image_fingerprint(const PreparedCapture& capture);

// As a checkpoint holds it. The error is a reason without a file's name.
std::string fingerprint_text(const Fingerprint& fingerprint);
Result<Fingerprint> read_fingerprint(const std::string& text);

// The value of an entry, "" where there is none.
std::string value_of(const Fingerprint& fingerprint, const std::string& name);

// kUsage where an entry of `now` is another in `found`, or is not there: names them, with both
// values. kBackendEntry and kProcessesEntry do not count. `path`, the checkpoint's, is for the
// message.
Status check_same_run(const std::string& path, const Fingerprint& found, const Fingerprint& now);

}  // namespace stgs::encoder
