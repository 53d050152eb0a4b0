// SPDX-License-Identifier: Apache-2.0
// Records a small scene live: a static floor, and a ball of splats that circles above it. Appends
// each fragment once its time has passed, as a capture would, and prints a line of JSON for it: the
// clip time that it covers, and when it was captured and appended, in seconds of the monotonic
// clock.
//
// usage: telepresence_recorder NEW.stgs SECONDS [FRAGMENT_SECONDS]
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "stgs/stgs_encoder.hpp"

namespace {

constexpr double kFramesPerSecond = 30;
constexpr std::uint32_t kMaxFrames = 30 * 3600;  // for which the floor is visible
constexpr std::uint32_t kOrbitFrames = 4 * 30;   // one revolution of the ball
constexpr float kTurn = 2 * 3.14159265f;

double now() {
  const auto since = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double>(since).count();
}

// Isotropic splats with view-independent colour; seconds, scene units.
struct Splats {
  std::vector<float> position, velocity, scale, opacity, sh, time, sigma, radius;

  void add(const float (&at)[3], const float (&moving)[3], const float (&colour)[3], float size) {
    constexpr float kSh0 = 0.28209479f;
    for (int c = 0; c < 3; ++c) {
      position.push_back(at[c]);
      velocity.push_back(moving[c]);
      scale.push_back(size);
      sh.push_back((colour[c] - 0.5f) / kSh0);
    }
    opacity.push_back(0.95f);
  }
  // Sets the lifespan of the last splat. Without lifespans all splats are visible throughout.
  void set_lifespan(float centre, float flat, float fade) {
    time.push_back(centre);
    radius.push_back(flat);
    sigma.push_back(fade);
  }
  // Returns a fragment that refers to the arrays.
  stgs_fragment fragment(std::uint32_t frames) const {
    stgs_fragment out = stgs::empty_fragment();
    out.frames = frames;
    out.count = opacity.size();
    out.position = position.data();
    out.velocity = velocity.data();
    out.scale = scale.data();
    out.opacity = opacity.data();
    out.sh = sh.data();
    if (!time.empty()) {
      out.time = time.data();
      out.sigma = sigma.data();
      out.radius = radius.data();
    }
    return out;
  }
};

Splats floor_tiles() {
  Splats splats;
  for (int x = -20; x <= 20; ++x) {
    for (int z = 0; z <= 40; ++z) {
      const float shade = (x + z) % 2 == 0 ? 0.35f : 0.6f;
      splats.add({0.15f * static_cast<float>(x), 1, 1 + 0.15f * static_cast<float>(z)}, {0, 0, 0},
                 {shade, shade, shade}, 0.06f);
    }
  }
  return splats;
}

// The ball in the frames [first, last). Each splat is visible for one or two frames.
Splats ball(std::uint32_t first, std::uint32_t last) {
  constexpr auto kFrame = static_cast<float>(1 / kFramesPerSecond);
  constexpr float kStep = kTurn / kOrbitFrames, kSpeed = 1.2f * kStep / kFrame;
  Splats splats;
  for (std::uint32_t frame = first; frame < last; ++frame) {
    const float angle = kStep * static_cast<float>(frame % kOrbitFrames);
    const float centre[3] = {1.2f * std::cos(angle), 0.3f, 4 + 1.2f * std::sin(angle)};
    const float velocity[3] = {-kSpeed * std::sin(angle), 0, kSpeed * std::cos(angle)};
    for (int i = 0; i < 200; ++i) {  // evenly spread over the sphere
      const float up = 1 - (static_cast<float>(i) + 0.5f) / 100,
                  around = 2.399963f * static_cast<float>(i);
      const float wide = std::sqrt(1 - up * up);
      splats.add({centre[0] + 0.4f * wide * std::cos(around), centre[1] + 0.4f * up,
                  centre[2] + 0.4f * wide * std::sin(around)},
                 velocity, {0.9f, 0.5f + 0.4f * up, 0.2f}, 0.04f);
      splats.set_lifespan(kFrame * static_cast<float>(frame - first), 0.7f * kFrame, 0.7f * kFrame);
    }
  }
  return splats;
}

void record(const std::string& path, double seconds, double fragment_seconds) {
  stgs_record_settings settings = stgs::record_settings();
  settings.sync = 0;  // low latency matters more than power failures
  stgs::Recorder recorder;
  recorder.begin(path, settings);
  const Splats floor = floor_tiles();
  stgs_fragment first_frame = floor.fragment(1);
  first_frame.visible_frames = kMaxFrames;
  recorder.append(first_frame);
  const double begin = now() - 1 / kFramesPerSecond;
  const auto frames = static_cast<std::uint32_t>(std::lround(fragment_seconds * kFramesPerSecond));
  std::uint32_t last = 1;
  while (last < seconds * kFramesPerSecond) {
    const std::uint32_t first = last;
    last += frames;
    const double captured = begin + last / kFramesPerSecond;
    std::this_thread::sleep_for(std::chrono::duration<double>(captured - now()));
    const Splats splats = ball(first, last);
    recorder.append(splats.fragment(frames));
    std::printf("{\"begin\": %.6f, \"end\": %.6f, \"captured\": %.6f, \"appended\": %.6f}\n",
                first / kFramesPerSecond, last / kFramesPerSecond, captured, now());
    std::fflush(stdout);
  }
  recorder.close();
}

}  // namespace

int main(int argc, char** argv) {
  const double seconds = argc >= 3 ? std::atof(argv[2]) : 0;
  const double fragment = argc == 4 ? std::atof(argv[3]) : 0.5;
  if (argc > 4 || !(seconds > 0 && seconds <= 3600) || !(fragment >= 0.1 && fragment <= 10)) {
    std::fprintf(stderr, "usage: telepresence_recorder NEW.stgs SECONDS [FRAGMENT_SECONDS]\n");
    return 1;
  }
  try {
    record(argv[1], seconds, fragment);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
