// SPDX-License-Identifier: Apache-2.0
#include "train_renders.h"

#include <algorithm>
#include <cmath>

#include "camera_file.h"
#include "image_io.h"
#include "stgs/encoder/held_out.h"
#include "stgs/encoder/metrics.h"
#include "turntable.h"
#include "video.h"

namespace stgs::tools {
namespace {

constexpr int kVideoFrames = 150;
constexpr TimeBase kVideoRate = {1, 25};
constexpr int kVideoWidth = 640, kVideoHeight = 480;  // at most, pixels
constexpr float kErrorScale = 5;

// The frames of the scene, rendered on the CPU.
class Renders {
 public:
  Renders(const Scene& scene, float near_plane) : scene_(scene), near_plane_(near_plane) {
    const float* background = scene.metadata.background;
    settings_.background = {background[0], background[1], background[2]};
    settings_.kernel = scene.metadata.kernel;
  }

  // Colours in [0, 1]; valid until the next call. `ticks`: time.
  const Image& render(const encoder::Camera& camera, double ticks) {
    stgs::render(scene_.gaussians, static_cast<float>(ticks), camera.pinhole(near_plane_),
                 settings_, frame_, output_);
    for (float& v : output_.colour.data) v = std::clamp(v, 0.0f, 1.0f);
    return output_.colour;
  }

 private:
  const Scene& scene_;
  float near_plane_;
  RasterSettings settings_;
  SplatFrame frame_;
  RasterOutput output_;
};

// The mean absolute error of each pixel over its channels, times kErrorScale, as grey levels.
encoder::Image8 error_map(const Image& render, const Image& truth) {
  Image grey;
  grey.reshape(render.width, render.height, 3);
  const std::size_t pixels = grey.data.size() / 3;
  for (std::size_t i = 0; i < pixels; ++i) {
    float error = 0;
    for (int c = 0; c < 3; ++c) error += std::abs(render.plane(c)[i] - truth.plane(c)[i]) / 3;
    for (int c = 0; c < 3; ++c) grey.plane(c)[i] = std::min(1.0f, kErrorScale * error);
  }
  return to_8bit(grey);
}

// Frame k of a clip that plays to and fro.
int to_and_fro(int k, int frames) {
  if (frames < 2) return 0;
  const int period = 2 * (frames - 1), at = k % period;
  return std::min(at, period - at);
}

// The largest even size of the same shape within the limits of the video.
Size video_size(const encoder::Camera& camera) {
  const double scale = std::min({1.0, static_cast<double>(kVideoWidth) / camera.width,
                                 static_cast<double>(kVideoHeight) / camera.height});
  const auto even = [scale](int size) {
    return std::max(2, 2 * static_cast<int>(std::floor(0.5 * scale * size)));
  };
  return {even(camera.width), even(camera.height)};
}

// The capture with the training cameras as they were trained with.
encoder::PreparedCapture trained_capture(const TrainReportInput& input) {
  encoder::PreparedCapture capture = input.capture;
  if (input.settings.foreground) capture.mask_background = encoder::kMaskBackground;
  for (const encoder::RefinedCamera& refined : input.report.cameras) {
    for (encoder::Camera& camera : capture.cameras) {
      if (camera.name == refined.camera.name) camera = refined.camera;
    }
  }
  return capture;
}

// `interrupted`: set if the run is to stop.
Status write_turntable(const TrainReportInput& input, const std::string& path, Session& session,
                       bool& interrupted) {
  STGS_ASSIGN(const auto writer, make_mp4_writer(path, kVideoRate, session.log_sink()));
  const encoder::PreparedCapture capture = trained_capture(input);
  Renders renders(input.scene, capture.near_plane);
  std::size_t k = 0;
  for (encoder::Camera& view : turntable(capture, kVideoFrames)) {
    view = resized(view, video_size(view));
    const Image& colour = renders.render(view, to_and_fro(static_cast<int>(k), capture.frames));
    STGS_TRY(writer->add(to_8bit(colour)));
    interrupted = !session.progress("report", ++k, kVideoFrames);
    if (interrupted) return runtime_error("interrupted; the report is not written");
  }
  return writer->finish();
}

}  // namespace

Status add_renders(const TrainReportInput& input, OutputFolder& files, encoder::ReportPage& page) {
  const encoder::PreparedCapture capture = trained_capture(input);
  auto views = encoder::sample_views(capture, true, encoder::kMaxHeldOutImages);
  const bool test = !views.empty();
  if (!test) views = encoder::sample_views(capture, false, encoder::kMaxHeldOutImages);
  page.heading(test ? "Test cameras: render, ground truth and error"
                    : "Training cameras (none was held out): render, ground truth and error");
  page.paragraph(
      fmt::format("Error: mean absolute difference of the channels; white is {:.0f} % or more.",
                  100 / kErrorScale));
  Renders renders(input.scene, capture.near_plane);
  for (const encoder::SampledView& view : views) {
    const encoder::Camera& camera = capture.cameras[view.camera];
    STGS_ASSIGN(const encoder::Image8 ground_truth,
                encoder::load_frame(capture, camera, view.frame));
    const Image truth = encoder::to_float(ground_truth);
    const Image& render = renders.render(camera, capture.time_of(camera, view.frame));
    const double psnr = encoder::psnr_of(encoder::mean_squared_error(render, truth));
    const std::string name = fmt::format("{}_{:06}.png", camera.name, view.frame);
    const std::string caption = fmt::format("{}, frame {}", camera.name, view.frame);
    const auto add = [&](const char* kind, const encoder::Image8& image,
                         const std::string& label) -> Status {
      const std::string file = fmt::format("{}_{}", kind, name);
      STGS_ASSIGN(const std::string path, files.add(file));
      page.image(file, fmt::format("{}: {}", caption, label));
      return write_png(path, image);
    };
    STGS_TRY(add("render", to_8bit(render), fmt::format("render, {:.2f} dB", psnr)));
    STGS_TRY(add("ground_truth", ground_truth, "ground truth"));
    STGS_TRY(add("error", error_map(render, truth), "error"));
  }
  return {};
}

Status add_turntable(const TrainReportInput& input, Session& session, OutputFolder& files,
                     encoder::ReportPage& page) {
  page.heading("Turn around the scene");
  const std::string name = "turntable.mp4";
  Status written = check_mp4_writer();
  if (written.ok()) {
    STGS_ASSIGN(const std::string path, files.add(name));
    bool interrupted = false;
    written = write_turntable(input, path, session, interrupted);
    if (interrupted) return written;
    if (!written.ok()) files.drop(name);
  }
  if (written.ok()) {
    page.video(name, "The clip to and fro, from a path between the cameras");
  } else {
    page.paragraph(fmt::format("No video: {}.", written.message()));
    session.log_sink()(1, fmt::format("the report has no video: {}", written.message()));
  }
  return {};
}

}  // namespace stgs::tools
