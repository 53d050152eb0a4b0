// SPDX-License-Identifier: Apache-2.0
// A small prepared capture with known content in a temporary folder: textured blobs on a wall, and
// one blob that crosses in front of it.
#pragma once

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/scene_file.h"
#include "temporary_folder.h"

namespace stgs::test {

struct SyntheticCapture {
  explicit SyntheticCapture(int cameras = 4, int frames = 6);
  SyntheticCapture(const SyntheticCapture&) = delete;
  SyntheticCapture& operator=(const SyntheticCapture&) = delete;

  testing::TemporaryFolder folder;
  encoder::PreparedCapture capture;
  Gaussians4D ground_truth;  // the primitives that the frames show
};

// PSNR in dB of a scene against the ground truth as the held-out camera sees it, mean over frames.
double held_out_psnr(const SyntheticCapture& synthetic, const Scene& scene);

}  // namespace stgs::test
