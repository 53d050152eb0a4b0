// SPDX-License-Identifier: Apache-2.0
// stgs_encoder.hpp is self-contained, can be included twice, and compiles as C++17.
#include "stgs/stgs_encoder.hpp"

#include "stgs/stgs_encoder.hpp"

std::uint64_t encoded_bytes(const std::string& capture, const std::string& output);
std::uint64_t encoded_bytes(const std::string& capture, const std::string& output) {
  stgs::Encoder encoder([](const stgs_encoder_progress& progress) { return progress.loss < 10; });
  encoder.check_training();
  encoder.prepare(capture, output + ".prepared");
  encoder.train(output + ".prepared", output + ".trained");
  return encoder.pack(output + ".trained", output).bytes_out;
}

std::uint64_t filmed_frames(const std::string& rig, const void* pixels);
std::uint64_t filmed_frames(const std::string& rig, const void* pixels) {
  stgs_live_settings settings = stgs::live_settings();
  settings.rig = rig.c_str();
  std::uint64_t written = 0;
  stgs::Live live;
  live.start("live.stgs", settings,
             [&](const stgs_live_window& window) { written += window.frames; });
  stgs_live_image image = stgs::live_image();
  image.data = pixels;
  image.width = image.height = 64;
  live.push("left", 0, image);
  live.end_camera("left");
  live.finish();
  return written + live.report().frames;
}
