// SPDX-License-Identifier: Apache-2.0
// The page of a training: curves, test renders, what lives how long, and what it was run with.
#pragma once

#include <string>

#include "session.h"
#include "stgs/encoder/train.h"
#include "stgs/format/scene_file.h"

namespace stgs::tools {

struct TrainReportInput {
  const encoder::PreparedCapture& capture;
  const encoder::TrainSettings& settings;  // its log has been written
  const encoder::TrainReport& report;
  const Scene& scene;  // as it was written to `output`
  std::string output;
};

// Writes index.html and its pictures into `folder`, which exists.
Status write_train_report(const std::string& folder, const TrainReportInput& input,
                          const Session& session);

}  // namespace stgs::tools
