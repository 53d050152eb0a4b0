// SPDX-License-Identifier: Apache-2.0
#include "live_frames.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "fixtures/moving_room.h"
#include "stgs/encoder/metrics.h"
#include "stgs/format/parallel.h"
#include "stgs/player/renderer.h"

namespace stgs::bench {
namespace {

using encoder::Camera;
using encoder::Image8;
using encoder::LivePreparer;

constexpr float kNearPlane = 0.01f;
constexpr int kMeasured = 10;  // frames, evenly spaced

encoder::PrepareSettings prepare_settings() {
  encoder::PrepareSettings settings;
  settings.trust_calibration = true;
  return settings;
}

class CapturedFrames final : public LiveFrames {
 public:
  Status open(const std::string& prepared, const std::string& rig, const encoder::LogSink& log) {
    STGS_ASSIGN(const encoder::PreparedCapture capture, encoder::read_prepared_capture(prepared));
    STGS_ASSIGN(preparer_,
                LivePreparer::open(rig, prepare_settings(), 1 / capture.time_base.seconds(1), log));
    for (const encoder::LiveCamera& camera : preparer_->cameras()) {
      STGS_ASSIGN(std::vector<Image8> frames, load(capture, camera.name));
      frames_.push_back(std::move(frames));
    }
    return {};
  }

  LivePreparer& preparer() override { return *preparer_; }
  const Image8& frame(std::size_t camera, int n) const override {
    const std::vector<Image8>& frames = frames_[camera];
    const int count = static_cast<int>(frames.size()), period = std::max(1, 2 * count - 2);
    const int k = n % period;
    return frames[static_cast<std::size_t>(k < count ? k : period - k)];
  }
  Result<std::vector<double>> psnr(const std::string&, int) const override {
    return std::vector<double>();
  }

 private:
  static Result<std::vector<Image8>> load(const encoder::PreparedCapture& capture,
                                          const std::string& name) {
    const auto found = std::find_if(capture.cameras.begin(), capture.cameras.end(),
                                    [&](const Camera& camera) { return camera.name == name; });
    if (found == capture.cameras.end())
      return usage_error("camera '{}' is not in {}", name, capture.folder);
    std::vector<Image8> frames(static_cast<std::size_t>(capture.frames));
    std::vector<Status> loaded(frames.size());
    parallel_for(std::size_t{0}, frames.size(), [&](std::size_t f) {
      Result<Image8> image = load_frame(capture, *found, static_cast<int>(f));
      loaded[f] = image.status();
      if (image.ok()) frames[f] = std::move(*image);
    });
    for (const Status& status : loaded) STGS_TRY(status);
    return frames;
  }

  std::unique_ptr<LivePreparer> preparer_;
  std::vector<std::vector<Image8>> frames_;  // by camera
};

encoder::RigCamera to_rig_camera(const Camera& camera) {
  encoder::RigCamera out;
  out.name = camera.name;
  out.width = camera.width;
  out.height = camera.height;
  out.fx = camera.fx;
  out.fy = camera.fy;
  out.cx = camera.cx;
  out.cy = camera.cy;
  for (std::size_t r = 0; r < 3; ++r) {
    std::copy_n(camera.rotation + 3 * r, 3, out.world_to_camera.begin() + 4 * r);
    out.world_to_camera[4 * r + 3] = camera.translation[r];
  }
  return out;
}

class RoomFrames final : public LiveFrames {
 public:
  Status open(const test::RoomRig& rig, double fps, int frames) {
    fps_ = fps;
    const auto texture = std::make_shared<const test::NoiseTexture>();
    std::vector<encoder::RigCamera> filming;
    std::vector<std::unique_ptr<test::RoomView>> views;
    for (const Camera& camera : test::room_cameras(rig)) {
      auto view = std::make_unique<test::RoomView>(texture, camera);
      if (!camera.test) filming.push_back(to_rig_camera(camera));
      (camera.test ? tests_ : views).push_back(std::move(view));
    }
    STGS_ASSIGN(preparer_, LivePreparer::open(filming, prepare_settings(), fps));
    frames_.assign(views.size(), std::vector<Image8>(static_cast<std::size_t>(frames)));
    parallel_for(0, frames, [&](int n) {
      for (std::size_t c = 0; c < views.size(); ++c)
        frames_[c][static_cast<std::size_t>(n)] = views[c]->render(n / fps);
    });
    return {};
  }

  LivePreparer& preparer() override { return *preparer_; }
  const Image8& frame(std::size_t camera, int n) const override {
    return frames_[camera][static_cast<std::size_t>(n)];
  }
  Result<std::vector<double>> psnr(const std::string& path, int frames) const override {
    STGS_ASSIGN(const auto timeline, player::Timeline::open(path));
    STGS_ASSIGN(const auto renderer, player::make_renderer("cpu"));
    std::vector<double> out;
    for (int i = 0; i < kMeasured; ++i) {
      const double seconds = std::floor((i + 0.5) * frames / kMeasured) / fps_;
      double error = 0;
      for (const auto& view : tests_) {
        std::vector<player::Frame> rendered;
        const float* b = timeline->metadata().background;
        STGS_TRY(renderer->render(*timeline, seconds,
                                  {{view->camera().pinhole(kNearPlane), {b[0], b[1], b[2]}}},
                                  rendered, nullptr));
        for (float& value : rendered[0].colour.data) value = std::clamp(value, 0.0f, 1.0f);
        error += encoder::mean_squared_error(rendered[0].colour,
                                             encoder::to_float(view->render(seconds)));
      }
      out.push_back(encoder::psnr_of(error / static_cast<double>(tests_.size())));
    }
    return out;
  }

 private:
  double fps_ = 0;
  std::unique_ptr<LivePreparer> preparer_;
  std::vector<std::unique_ptr<test::RoomView>> tests_;
  std::vector<std::vector<Image8>> frames_;  // by camera
};

}  // namespace

Result<std::unique_ptr<LiveFrames>> open_captured_frames(const std::string& prepared,
                                                         const std::string& rig,
                                                         const encoder::LogSink& log) {
  auto frames = std::make_unique<CapturedFrames>();
  STGS_TRY(frames->open(prepared, rig, log));
  return std::unique_ptr<LiveFrames>(std::move(frames));
}

Result<std::unique_ptr<LiveFrames>> render_room_frames(const std::string& rig, double seconds) {
  test::RoomRig room;
  double fps = 0;
  char excess = 0;
  if (std::sscanf(rig.c_str(), "%dx%dx%d@%lf%c", &room.cameras, &room.width, &room.height, &fps,
                  &excess) != 4 ||
      room.cameras < 2 || room.width < 1 || room.height < 1 || !(fps > 0))
    return usage_error("{}: invalid rig (expected CAMERASxWIDTHxHEIGHT@FPS)", rig);
  auto frames = std::make_unique<RoomFrames>();
  STGS_TRY(frames->open(room, fps, static_cast<int>(std::ceil(seconds * fps))));
  return std::unique_ptr<LiveFrames>(std::move(frames));
}

}  // namespace stgs::bench
