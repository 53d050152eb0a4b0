// SPDX-License-Identifier: Apache-2.0
#include "synthetic_capture.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <random>
#include <stdexcept>

#include "stgs/format/raster.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STB_IMAGE_WRITE_STATIC
#include <stb_image_write.h>
#pragma GCC diagnostic pop

namespace stgs::test {
namespace {

constexpr int kWidth = 96, kHeight = 64;
constexpr int kStatic = 220, kDynamic = 12;

float uniform(std::mt19937& random, float low, float high) {
  return low + (high - low) * static_cast<float>(random() >> 8) * 0x1p-24f;
}

Gaussians4D make_scene(int frames) {
  std::mt19937 random(7);
  Gaussians4D set;
  set.resize(kStatic + kDynamic);
  for (int i = 0; i < kStatic + kDynamic; ++i) {
    const bool dynamic = i >= kStatic;
    float* p = &set.position[3 * i];
    p[0] = dynamic ? uniform(random, -0.5f, -0.3f) : uniform(random, -1.6f, 1.6f);
    p[1] = dynamic ? uniform(random, -0.1f, 0.1f) : uniform(random, -1.1f, 1.1f);
    p[2] = dynamic ? uniform(random, 1.9f, 2.1f) : uniform(random, 2.9f, 3.1f);
    for (int c = 0; c < 3; ++c) {
      set.log_scale[3 * i + c] = std::log(dynamic ? 0.06f : uniform(random, 0.06f, 0.14f));
      set.sh[3 * i + c] = uniform(random, -1.5f, 1.5f);
    }
    set.rotation[4 * i] = 1.0f;
    set.opacity_logit[i] = 2.0f;
    set.time[i] = 0.5f * static_cast<float>(frames - 1);
    set.sigma[i] = 1.0f;
    set.radius[i] = 100.0f;
    if (dynamic) set.velocity[3 * i] = 0.7f / static_cast<float>(frames);
  }
  return set;
}

encoder::Camera make_camera(int index, int cameras) {
  encoder::Camera camera;
  camera.name = fmt::format("cam{:02}", index);
  camera.width = kWidth;
  camera.height = kHeight;
  camera.fx = camera.fy = 80.0;
  camera.cx = 0.5 * kWidth;
  camera.cy = 0.5 * kHeight;
  camera.test = index == 0;
  // cam00 is in the middle, the others are on an arc around it.
  const double angle = index == 0 ? 0.0 : 0.3 * (2.0 * (index - 1) / (cameras - 2.0) - 1.0);
  const double c = std::cos(angle), s = std::sin(angle);
  const double rotation[9] = {c, 0, -s, 0, 1, 0, s, 0, c};
  std::copy_n(rotation, 9, camera.rotation);
  const double pivot = 2.5;  // the camera looks at (0,0,pivot) from that distance
  camera.translation[0] = s * pivot;
  camera.translation[2] = pivot - c * pivot;
  if (index % 2 == 1) camera.translation[1] = 0.15;
  return camera;
}

std::vector<std::uint8_t> to_bytes(const Image& image) {
  std::vector<std::uint8_t> bytes(std::size_t{3} * image.width * image.height);
  for (int c = 0; c < 3; ++c) {
    for (int i = 0; i < image.width * image.height; ++i) {
      const float v = std::clamp(image.plane(c)[i], 0.0f, 1.0f);
      bytes[std::size_t{3} * i + c] = static_cast<std::uint8_t>(std::lround(255.0f * v));
    }
  }
  return bytes;
}

void write_frames(const encoder::PreparedCapture& capture, const Gaussians4D& ground_truth) {
  SplatFrame frame;
  RasterOutput output;
  for (const encoder::Camera& camera : capture.cameras) {
    std::filesystem::create_directories(capture.folder + "/frames/" + camera.name);
    for (int f = 0; f < capture.frames; ++f) {
      render(ground_truth, static_cast<float>(f), camera.pinhole(capture.near_plane), {}, frame,
             output);
      const std::vector<std::uint8_t> bytes = to_bytes(output.colour);
      if (!stbi_write_png(capture.frame_path(camera, f).c_str(), camera.width, camera.height, 3,
                          bytes.data(), 3 * camera.width)) {
        throw std::runtime_error("cannot write a test frame");
      }
    }
  }
}

// Grey points, displaced from the ground truth by at most 0.03 units per axis.
void write_initial_points(const encoder::PreparedCapture& capture,
                          const Gaussians4D& ground_truth) {
  std::mt19937 random(11);
  std::vector<encoder::InitialPoint> static_points, dynamic_points;
  for (int i = 0; i < kStatic + kDynamic; ++i) {
    encoder::InitialPoint point{};
    point.frame = -1;
    std::fill_n(point.colour, 3, std::uint8_t{128});
    for (int c = 0; c < 3; ++c)
      point.position[c] = ground_truth.position[3 * i + c] + uniform(random, -0.03f, 0.03f);
    if (i < kStatic) {
      static_points.push_back(point);
      continue;
    }
    const encoder::InitialPoint middle = point;
    for (int f = 0; f < capture.frames; ++f) {
      point.frame = f;
      for (int c = 0; c < 3; ++c) {
        point.velocity[c] = ground_truth.velocity[3 * i + c];
        point.position[c] =
            middle.position[c] + point.velocity[c] * (static_cast<float>(f) - ground_truth.time[i]);
      }
      dynamic_points.push_back(point);
    }
  }
  const bool ok =
      encoder::write_points(capture.folder + "/points_static.ply", static_points).ok() &&
      encoder::write_points(capture.folder + "/points_dynamic.ply", dynamic_points).ok();
  if (!ok) throw std::runtime_error("cannot write the test points");
}

}  // namespace

SyntheticCapture::SyntheticCapture(int cameras, int frames) {
  capture.folder = folder.path;
  for (int i = 0; i < cameras; ++i) capture.cameras.push_back(make_camera(i, cameras));
  capture.frames = frames;
  capture.source = "synthetic";
  capture.near_plane = 0.3f;
  capture.extent = 0.8f;
  capture.scene_centre[2] = 2.5;
  capture.scene_radius = 1.5;
  ground_truth = make_scene(frames);
  write_frames(capture, ground_truth);
  write_initial_points(capture, ground_truth);
  if (!encoder::write_prepared_capture(capture).ok()) {
    throw std::runtime_error("cannot write capture.json");
  }
}

double held_out_psnr(const SyntheticCapture& synthetic, const Scene& scene) {
  const encoder::PreparedCapture& capture = synthetic.capture;
  const encoder::Camera& camera = capture.cameras.front();
  SplatFrame frame;
  RasterOutput rendered, ground_truth;
  RasterSettings settings;
  const float* background = scene.metadata.background;
  settings.background = {background[0], background[1], background[2]};
  double sum = 0;
  for (int f = 0; f < capture.frames; ++f) {
    const math::PinholeCamera pinhole = camera.pinhole(capture.near_plane);
    render(scene.gaussians, static_cast<float>(f), pinhole, settings, frame, rendered);
    render(synthetic.ground_truth, static_cast<float>(f), pinhole, {}, frame, ground_truth);
    double squares = 0;
    for (std::size_t i = 0; i < ground_truth.colour.data.size(); ++i) {
      const double d = ground_truth.colour.data[i] - rendered.colour.data[i];
      squares += d * d;
    }
    sum += -10.0 * std::log10(squares / static_cast<double>(ground_truth.colour.data.size()));
  }
  return sum / capture.frames;
}

}  // namespace stgs::test
