// SPDX-License-Identifier: Apache-2.0
// The report page of a training: curves, test renders, lifespans, and the settings of the run.
#pragma once

#include <string>

#include "session.h"
#include "stgs/encoder/train.h"
#include "stgs/format/scene_file.h"

namespace stgs::tools {

struct TrainReportInput {
  const encoder::PreparedCapture& capture;
  const encoder::TrainSettings& settings;  // the log at settings.log_path is complete
  const encoder::TrainReport& report;
  const Scene& scene;  // as it was written to `output`
  std::string output;
};

// Writes index.html and its images into `folder`, once all are complete. After an error the folder
// has none of them.
Status write_train_report(const std::string& folder, const TrainReportInput& input,
                          Session& session);

}  // namespace stgs::tools
