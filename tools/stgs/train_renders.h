// SPDX-License-Identifier: Apache-2.0
// The images and the video of a training report.
#pragma once

#include "output_folder.h"
#include "stgs/encoder/report_page.h"
#include "train_report.h"

namespace stgs::tools {

// Renders a sample of the views from the final scene, next to the captured frames and to the
// errors.
Status add_renders(const TrainReportInput& input, OutputFolder& files, encoder::ReportPage& page);

// Renders a video that turns around the scene (turntable.h) while the clip plays to and fro. If it
// cannot be written, as in a build without OpenCV, the page and the log state why. kRuntime if the
// run is interrupted.
Status add_turntable(const TrainReportInput& input, Session& session, OutputFolder& files,
                     encoder::ReportPage& page);

}  // namespace stgs::tools
