// SPDX-License-Identifier: Apache-2.0
// Encodes four cameras while they film: a thread for each camera pushes its images, as the capture
// threads of an application do. Here the cameras are simulated: they film a ball that circles above
// a floor, in front of a wall. Prints a line of JSON for each window: the clip time that it covers,
// and when it was filmed and appended, in seconds of the monotonic clock.
//
// usage: telepresence_cameras NEW.stgs SECONDS
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <future>
#include <thread>

#include "stgs/stgs_encoder.hpp"

namespace {

constexpr double kFramesPerSecond = 10;
constexpr std::uint32_t kWidth = 112, kHeight = 84;  // pixels
constexpr float kFocalLength = 98;                   // pixels
constexpr double kOrbitSeconds = 6;                  // one revolution of the ball

using stgs::Vector3;

double now() {
  const auto since = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double>(since).count();
}

void sleep_until(double time) {
  std::this_thread::sleep_for(std::chrono::duration<double>(time - now()));
}

Vector3 at(const Vector3& origin, const Vector3& direction, float distance) {
  return {origin[0] + distance * direction[0], origin[1] + distance * direction[1],
          origin[2] + distance * direction[2]};
}

float dot(const Vector3& a, const Vector3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Tiles of random brightness in a tint.
Vector3 tile(float u, float v, const Vector3& tint) {
  const float cell = std::floor(2.5f * u) * 12.9898f + std::floor(2.5f * v) * 78.233f;
  const float noise = std::abs(std::fmod(std::sin(cell) * 43758.5f, 1.0f));
  return at({0, 0, 0}, tint, 0.35f + 0.65f * noise);
}

// Returns the distance along a ray to a sphere; infinity beside it.
float distance_to(const Vector3& centre, float radius, const Vector3& origin, const Vector3& ray) {
  const Vector3 offset = at(origin, centre, -1);
  const float half = dot(offset, ray), length = dot(ray, ray);
  const float root = half * half - length * (dot(offset, offset) - radius * radius);
  return root < 0 ? INFINITY : (-half - std::sqrt(root)) / length;
}

// Returns the colour that a ray meets; axes as in OpenCV, so y points down.
Vector3 colour_of(const Vector3& origin, const Vector3& ray, double seconds) {
  const auto angle = static_cast<float>(2 * 3.14159265 * seconds / kOrbitSeconds);
  const Vector3 centre = {1.1f * std::cos(angle), 0.3f, 4 + 1.1f * std::sin(angle)};
  const float to_ball = distance_to(centre, 0.45f, origin, ray);
  const float to_wall = (6 - origin[2]) / ray[2];
  const float to_floor = ray[1] > 0 ? (1 - origin[1]) / ray[1] : INFINITY;
  if (to_ball < std::min(to_wall, to_floor)) {
    const Vector3 on_ball = at(at(origin, ray, to_ball), centre, -1);
    return at({0.5f, 0.3f, 0.1f}, {1, 1, 1}, 0.4f * std::abs(std::sin(9 * on_ball[1])));
  }
  if (to_floor < to_wall) {
    const Vector3 on_floor = at(origin, ray, to_floor);
    return tile(on_floor[0], on_floor[2], {0.9f, 0.9f, 0.8f});
  }
  const Vector3 on_wall = at(origin, ray, to_wall);
  return tile(on_wall[0] + 40, on_wall[1], {0.5f, 0.7f, 0.9f});
}

// A camera that does not move.
class SimulatedCamera {
 public:
  SimulatedCamera(std::string name, const Vector3& position)
      : name_(std::move(name)), position_(position) {
    view_.fx = view_.fy = kFocalLength;
    view_.cx = kWidth / 2.0f;
    view_.cy = kHeight / 2.0f;
    view_.width = kWidth;
    view_.height = kHeight;
    view_ = stgs::looking_at(view_, position, {0, 0.3f, 4}, {0, -1, 0});
  }

  const std::string& name() const { return name_; }
  stgs_live_camera calibration() const {
    stgs_live_camera out = stgs::live_camera();
    out.name = name_.c_str();
    out.width = kWidth;
    out.height = kHeight;
    out.fx = view_.fx;
    out.fy = view_.fy;
    out.cx = view_.cx;
    out.cy = view_.cy;
    std::copy_n(view_.rotation, 9, out.rotation);
    std::copy_n(view_.translation, 3, out.translation);
    return out;
  }
  // Fills 8-bit RGB pixels.
  void film(double seconds, std::vector<std::uint8_t>& rgb) const {
    rgb.clear();
    const float* r = view_.rotation;
    for (std::uint32_t y = 0; y < kHeight; ++y) {
      for (std::uint32_t x = 0; x < kWidth; ++x) {
        const float u = (static_cast<float>(x) + 0.5f - view_.cx) / view_.fx;
        const float v = (static_cast<float>(y) + 0.5f - view_.cy) / view_.fy;
        const Vector3 ray = {r[0] * u + r[3] * v + r[6], r[1] * u + r[4] * v + r[7],
                             r[2] * u + r[5] * v + r[8]};
        for (const float c : colour_of(position_, ray, seconds))
          rgb.push_back(static_cast<std::uint8_t>(255 * c));
      }
    }
  }

 private:
  std::string name_;
  Vector3 position_;
  stgs_view view_ = stgs::default_view();
};

// The capture thread of a camera. `begin`: when filming begins, seconds of the monotonic clock.
void film(stgs::Live& live, const SimulatedCamera& camera, double begin, double seconds) {
  std::vector<std::uint8_t> rgb;
  for (int frame = 0; frame < seconds * kFramesPerSecond; ++frame) {
    const double time = frame / kFramesPerSecond;
    sleep_until(begin + time);
    camera.film(time, rgb);
    stgs_live_image image = stgs::live_image();
    image.data = rgb.data();
    image.width = kWidth;
    image.height = kHeight;
    live.push(camera.name(), time, image);
  }
  live.end_camera(camera.name());
}

stgs_live_settings settings_for(const std::vector<stgs_live_camera>& calibration) {
  stgs_live_settings settings = stgs::live_settings();
  settings.cameras = calibration.data();
  settings.camera_count = static_cast<std::uint32_t>(calibration.size());
  settings.fps = kFramesPerSecond;
  settings.iterations = 200;  // enough for this scene
  settings.max_primitives = 3000;
  settings.log = [](void*, stgs_log_level level, const char* message) {
    if (level <= STGS_LOG_WARNING) std::fprintf(stderr, "%s\n", message);
  };
  return settings;
}

void encode(const std::string& path, double seconds) {
  std::vector<SimulatedCamera> cameras;
  std::vector<stgs_live_camera> calibration;
  for (const float x : {-1.2f, -0.4f, 0.4f, 1.2f})
    cameras.emplace_back("camera" + std::to_string(cameras.size()), Vector3{x, -0.2f, 0});
  for (const SimulatedCamera& camera : cameras) calibration.push_back(camera.calibration());
  stgs::Live live;
  const double begin = now() + 0.1;
  live.start(path, settings_for(calibration), [begin](const stgs_live_window& window) {
    const double first = window.first_frame / kFramesPerSecond,
                 end = first + window.frames / kFramesPerSecond;
    std::printf("{\"begin\": %.6f, \"end\": %.6f, \"captured\": %.6f, \"appended\": %.6f}\n", first,
                end, begin + end, now());
    std::fflush(stdout);
  });
  std::vector<std::future<void>> filming;
  for (const SimulatedCamera& camera : cameras) {
    filming.push_back(std::async(std::launch::async, [&live, &camera, begin, seconds] {
      film(live, camera, begin, seconds);
    }));
  }
  for (std::future<void>& camera : filming) {
    try {
      camera.get();
    } catch (const stgs::Error& error) {
      if (error.result() != STGS_ERROR_STATE) throw;
      break;  // encoding has ended by an error, which finish() throws
    }
  }
  live.finish();
  const stgs_live_report report = live.report();
  std::fprintf(stderr, "%u frames, %llu images dropped, latency %.2f s (95 %% within %.2f s)\n",
               report.frames, static_cast<unsigned long long>(report.dropped),
               report.latency_median, report.latency_p95);
}

}  // namespace

int main(int argc, char** argv) {
  const double seconds = argc == 3 ? std::atof(argv[2]) : 0;
  if (!(seconds > 0 && seconds <= 3600)) {
    std::fprintf(stderr, "usage: telepresence_cameras NEW.stgs SECONDS\n");
    return 1;
  }
  try {
    encode(argv[1], seconds);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
