// SPDX-License-Identifier: Apache-2.0
// Live sessions of the C API, and the cameras of a synthetic capture that push to them.
#pragma once

#include <chrono>
#include <cmath>
#include <thread>

#include "sdk_recorder_fixture.h"
#include "stgs/encoder/frame_memory.h"

namespace stgs::testing {

struct DestroyLive {
  void operator()(stgs_live* live) const { stgs_live_destroy(live); }
};
using LivePtr = std::unique_ptr<stgs_live, DestroyLive>;

inline LivePtr make_live() {
  stgs_live* live = nullptr;
  REQUIRE(stgs_live_create(&live) == STGS_OK);
  return LivePtr(live);
}
inline std::string message_of(const LivePtr& live) {
  auto error = empty_output<stgs_error>();
  REQUIRE(stgs_live_error(live.get(), &error) == STGS_OK);
  return error.message;
}
inline stgs_live_report report_of(const LivePtr& live) {
  auto report = empty_output<stgs_live_report>();
  REQUIRE(stgs_live_get_report(live.get(), &report) == STGS_OK);
  return report;
}
inline stgs_live_image empty_live_image() {
  stgs_live_image image;
  REQUIRE(stgs_live_image_defaults(&image, sizeof image) == STGS_OK);
  return image;
}

// Pixels with the bytes of a format and padding after each row.
struct LivePixels {
  std::vector<std::uint8_t> bytes;
  stgs_live_image image = empty_live_image();

  LivePixels(const encoder::Image8& rgb, stgs_pixel_format format, std::size_t padding = 0) {
    const bool bgr = format == STGS_PIXELS_BGR8 || format == STGS_PIXELS_BGRA8;
    const bool alpha = format == STGS_PIXELS_RGBA8 || format == STGS_PIXELS_BGRA8;
    for (int y = 0; y < rgb.height; ++y) {
      for (int x = 0; x < rgb.width; ++x) {
        const std::uint8_t* from = rgb.data.data() + 3 * (y * rgb.width + x);
        for (int c = 0; c < 3; ++c) bytes.push_back(from[bgr ? 2 - c : c]);
        if (alpha) bytes.push_back(static_cast<std::uint8_t>(x));
      }
      bytes.resize(bytes.size() + padding, 0xA5);
    }
    image.data = bytes.data();
    image.width = static_cast<std::uint32_t>(rgb.width);
    image.height = static_cast<std::uint32_t>(rgb.height);
    image.format = format;
    if (padding > 0) image.stride = bytes.size() / image.height;
  }
};

// A rig of three cameras that films a synthetic capture, and a recording in its folder.
struct FilmedCapture {
  static constexpr double kFps = 20;
  static constexpr int kFrames = 20;

  test::SyntheticCapture synthetic{4, kFrames};
  std::vector<encoder::Camera> cameras = synthetic.capture.training_cameras();
  std::vector<stgs_live_camera> calibration;
  std::string recording = path("live.stgs");

  FilmedCapture() {
    for (const encoder::Camera& from : cameras) {
      stgs_live_camera& camera = calibration.emplace_back();
      REQUIRE(stgs_live_camera_defaults(&camera, sizeof camera) == STGS_OK);
      camera.name = from.name.c_str();
      camera.width = static_cast<std::uint32_t>(from.width);
      camera.height = static_cast<std::uint32_t>(from.height);
      camera.fx = from.fx;
      camera.fy = from.fy;
      camera.cx = from.cx;
      camera.cy = from.cy;
      std::copy_n(from.rotation, 9, camera.rotation);
      std::copy_n(from.translation, 3, camera.translation);
    }
  }

  std::string path(const char* name) const { return synthetic.capture.folder + "/" + name; }
  // A short run on the CPU.
  stgs_live_settings settings() const {
    stgs_live_settings settings;
    REQUIRE(stgs_live_settings_defaults(&settings, sizeof settings) == STGS_OK);
    settings.cameras = calibration.data();
    settings.camera_count = static_cast<std::uint32_t>(calibration.size());
    settings.fps = kFps;
    settings.latency = 0.5;
    settings.start_seconds = 0.5;
    settings.backend = STGS_BACKEND_CPU;
    settings.iterations = 300;
    settings.max_primitives = 600;
    return settings;
  }
  LivePtr start(const stgs_live_settings& settings) const {
    LivePtr live = make_live();
    const stgs_result result = stgs_live_start(live.get(), recording.c_str(), &settings);
    INFO(message_of(live));
    REQUIRE(result == STGS_OK);
    return live;
  }
  // Returns the pixels of a frame, in another format for each camera.
  LivePixels pixels(std::size_t camera, int frame) const {
    return {*encoder::load_frame(synthetic.capture, cameras[camera], frame),
            static_cast<stgs_pixel_format>(camera % 4), 7 * (camera % 2)};
  }
  stgs_result push(const LivePtr& live, std::size_t camera, int frame) const {
    const LivePixels pushed = pixels(camera, frame);
    return stgs_live_push(live.get(), calibration[camera].name, 1e6 + frame / kFps, &pushed.image);
  }
  void push_all(const LivePtr& live, int begin, int end) const {
    for (int frame = begin; frame < end; ++frame)
      for (std::size_t c = 0; c < cameras.size(); ++c) REQUIRE(push(live, c, frame) == STGS_OK);
  }
};

// PSNR in dB of frames that the scene shows, as the held-out camera sees them.
inline double psnr_of(const FilmedCapture& filmed, const ScenePtr& scene,
                      std::initializer_list<int> frames) {
  const encoder::PreparedCapture& capture = filmed.synthetic.capture;
  const encoder::Camera& camera = *std::find_if(capture.cameras.begin(), capture.cameras.end(),
                                                [](const auto& c) { return c.test; });
  stgs_view view = small_view();
  view.width = static_cast<std::uint32_t>(camera.width);
  view.height = static_cast<std::uint32_t>(camera.height);
  view.fx = static_cast<float>(camera.fx);
  view.fy = static_cast<float>(camera.fy);
  view.cx = static_cast<float>(camera.cx);
  view.cy = static_cast<float>(camera.cy);
  for (int i = 0; i < 9; ++i) view.rotation[i] = static_cast<float>(camera.rotation[i]);
  for (int i = 0; i < 3; ++i) view.translation[i] = static_cast<float>(camera.translation[i]);
  const RendererPtr renderer = cpu_renderer();
  double squares = 0, values = 0;
  for (const int frame : frames) {
    const auto shown = render_rgba8(renderer.get(), scene.get(), frame / filmed.kFps, view);
    const encoder::Image8 expected = *encoder::load_frame(capture, camera, frame);
    for (std::size_t i = 0; i < expected.data.size(); ++i) {
      squares += std::pow(int{shown[4 * (i / 3) + i % 3]} - int{expected.data[i]}, 2);
      ++values;
    }
  }
  return 10 * std::log10(255.0 * 255.0 * values / squares);
}

inline void wait_for_windows(const LivePtr& live, std::uint32_t windows) {
  while (report_of(live).windows < windows && report_of(live).ended == 0)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  REQUIRE(report_of(live).windows >= windows);
}

}  // namespace stgs::testing
