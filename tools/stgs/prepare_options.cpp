// SPDX-License-Identifier: Apache-2.0
#include "encode_options.h"

#include "allow_outside.h"
#include "opencv.h"
#include "options.h"
#include "parameter_options.h"
#include "protocol_option.h"
#include "usage.h"
#include "video_decoder_option.h"

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace stgs::tools {
namespace {

// Preparation allocates and frees large buffers many times. If each is returned to the system, this
// clears its pages again and again, which takes up to a quarter of the time.
void keep_freed_memory() {
#ifdef __GLIBC__
  constexpr int kMib = 1 << 20;
  mallopt(M_MMAP_THRESHOLD, static_cast<int>(sizeof(long)) * 4 * kMib);  // the maximum
  mallopt(M_TRIM_THRESHOLD, 512 * kMib);
  mallopt(M_TOP_PAD, 16 * kMib);
#endif
}

}  // namespace

void PrepareOptions::declare(Arguments& app) {
  const char* group = "Preparing";
  auto* layout = with_choices(app.add_option("--layout", layout_, "Layout of CAPTURE"),
                              {encoder::kLayoutNames.begin(), encoder::kLayoutNames.end()})
                     ->capture_default_str()
                     ->group(group);
  auto* frames =
      app.add_option("--frames", frames_, "Source frames FIRST:END, END excluded (default: all)")
          ->check(accepted_by<parse_open_frames>)
          ->group(group);
  scale_ = declare_parameters<encoder::PrepareParameters>(app, settings_, group).at("scale");
  auto* test_cameras =
      app.add_option(
             "--test-cameras", test_cameras_,
             "Cameras to hold out: comma-separated names, or none (default: as the layout defines)")
          ->group(group);
  add_protocol(app, protocol_,
               "Prepare the layout, frames, scale and test camera of a protocol of the paper, for "
               "evaluate --protocol")
      ->excludes(layout)
      ->excludes(frames)
      ->excludes(test_cameras)
      ->group(group);
  app.add_flag("--no-split", no_split_,
               "Skip motion detection: use static points of the first frame only")
      ->group(group);
  app.add_flag("--overwrite", settings_.overwrite, "Replace an existing prepared capture")
      ->group(group);
  add_allow_outside(app, settings_.allow_outside)->group(group);
  add_video_decoder(app, settings_.video_decoder)->group(group);
  app.add_flag("--trust-calibration", settings_.trust_calibration,
               "Only warn if a mistake in the calibration is found")
      ->group(group);
}

Result<encoder::PrepareSettings> PrepareOptions::settings(const CommonOptions& common) const {
  encoder::PrepareSettings settings = settings_;
  const auto* const layout =
      std::find(encoder::kLayoutNames.begin(), encoder::kLayoutNames.end(), layout_);
  settings.layout = static_cast<encoder::Layout>(layout - encoder::kLayoutNames.begin());
  if (!frames_.empty()) {
    STGS_ASSIGN(const FrameRange range, parse_open_frames(frames_));
    settings.first_frame = range.begin;
    settings.end_frame = range.end;
  }
  settings.default_test_cameras = test_cameras_.empty();
  if (test_cameras_ != "none") settings.test_cameras = split_list(test_cameras_);
  if (const encoder::Protocol* protocol = encoder::find_protocol(protocol_)) {
    const double scale = scale_->count() > 0 ? settings_.scale : 0;
    STGS_TRY(encoder::apply_protocol(*protocol, scale, settings));
  }
  settings.separate_motion = !no_split_;
  settings.seed = common.seed;
  settings.backend = common.backend;
  return settings;
}

Status prepare_stage(const std::string& capture, const std::string& folder,
                     const PrepareOptions& options, Session& session,
                     const std::function<Status(const encoder::PreparedCapture&)>& accept) {
  STGS_ASSIGN(encoder::PrepareSettings settings, options.settings(session.options));
  settings.accept = accept;
  keep_freed_memory();
  return prepare_capture(capture, folder, settings, session);
}

Result<std::unique_ptr<encoder::WindowPreparer>> open_stage(
    const std::string& capture, int window, const PrepareOptions& options, Session& session,
    const std::function<Status(const encoder::PreparedCapture&)>& accept) {
  STGS_ASSIGN(encoder::PrepareSettings settings, options.settings(session.options));
  settings.accept = accept;
  settings.share = session.machine_share();
  settings.may_calibrate = session.world() == nullptr;
  keep_freed_memory();
  return open_windows(capture, settings, window, session);
}

}  // namespace stgs::tools
