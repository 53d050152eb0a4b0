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

}  // namespace

Status add_renders(const TrainReportInput& input, OutputFolder& files, encoder::ReportPage& page) {
  auto views = encoder::sample_views(input.capture, true, encoder::kMaxHeldOutImages);
  const bool test = !views.empty();
  if (!test) views = encoder::sample_views(input.capture, false, encoder::kMaxHeldOutImages);
  page.heading(test ? "Test cameras: render, ground truth and error"
                    : "Training cameras (none was held out): render, ground truth and error");
  page.paragraph(
      fmt::format("Error: mean absolute difference of the channels; white is {:.0f} % or more.",
                  100 / kErrorScale));
  Renders renders(input.scene, input.capture.near_plane);
  for (const encoder::SampledView& view : views) {
    const encoder::Camera& camera = input.capture.cameras[view.camera];
    STGS_ASSIGN(const encoder::Image8 ground_truth,
                encoder::load_frame(input.capture, camera, view.frame));
    const Image truth = encoder::to_float(ground_truth);
    const Image& render = renders.render(camera, view.frame);
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

Status add_turntable(const TrainReportInput& input, const encoder::LogSink& log,
                     OutputFolder& files, encoder::ReportPage& page) {
  if (const Status possible = check_mp4_writer(); !possible.ok()) {
    page.paragraph(fmt::format("No video: {}", possible.message()));
    log(1, fmt::format("the report has no video: {}", possible.message()));
    return {};
  }
  const std::string name = "turntable.mp4";
  STGS_ASSIGN(const std::string path, files.add(name));
  STGS_ASSIGN(const auto writer, make_mp4_writer(path, kVideoRate, log));
  Renders renders(input.scene, input.capture.near_plane);
  int k = 0;
  for (encoder::Camera& view : turntable(input.capture, kVideoFrames)) {
    view = resized(view, video_size(view));
    const Image& colour = renders.render(view, to_and_fro(k++, input.capture.frames));
    STGS_TRY(writer->add(to_8bit(colour)));
  }
  STGS_TRY(writer->finish());
  page.heading("Turn around the scene");
  page.video(name, "The clip to and fro, from a path between the cameras");
  return {};
}

}  // namespace stgs::tools
