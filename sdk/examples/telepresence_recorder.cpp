// SPDX-License-Identifier: Apache-2.0
// Records a small scene live: a room that stays, and a ball of splats that goes round in it. Each
// stretch of time is appended once it is over, as a capture would be. For each it prints a line of
// JSON with the moments it holds and when it was there, seconds of the machine's monotonic clock.
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
constexpr std::uint32_t kLongestFrames = 30 * 3600;  // for which the room stays
constexpr std::uint32_t kRoundFrames = 4 * 30;       // of the ball
constexpr float kTurn = 2 * 3.14159265f;

double now() {
  const auto since = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double>(since).count();
}

// Round splats of a colour, which are the same from all sides: seconds, scene units.
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
  // Of the last that was added, which else are seen for all of the stretch.
  void set_lifespan(float centre, float flat, float fade) {
    time.push_back(centre);
    radius.push_back(flat);
    sigma.push_back(fade);
  }
  // Borrows them.
  stgs_fragment stretch(std::uint32_t frames) const {
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

// A floor of tiles.
Splats room() {
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

// The ball in the frames [first, last): its splats live for a frame or two and follow each other.
Splats ball(std::uint32_t first, std::uint32_t last) {
  constexpr auto kFrame = static_cast<float>(1 / kFramesPerSecond);
  constexpr float kStep = kTurn / kRoundFrames, kSpeed = 1.2f * kStep / kFrame;
  Splats splats;
  for (std::uint32_t frame = first; frame < last; ++frame) {
    const float angle = kStep * static_cast<float>(frame % kRoundFrames);
    const float centre[3] = {1.2f * std::cos(angle), 0.3f, 4 + 1.2f * std::sin(angle)};
    const float velocity[3] = {-kSpeed * std::sin(angle), 0, kSpeed * std::cos(angle)};
    for (int i = 0; i < 200; ++i) {  // evenly on a sphere
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

void record(const std::string& path, double seconds, double stretch_seconds) {
  stgs_record_settings settings = stgs::record_settings();
  settings.sync = 0;  // a viewer does not wait for the disk
  stgs::Recorder recorder;
  recorder.begin(path, settings);
  const Splats floor = room();
  stgs_fragment first_frame = floor.stretch(1);
  first_frame.visible_frames = kLongestFrames;
  recorder.append(first_frame);
  const double begin = now() - 1 / kFramesPerSecond;
  const auto frames = static_cast<std::uint32_t>(std::lround(stretch_seconds * kFramesPerSecond));
  std::uint32_t last = 1;
  while (last < seconds * kFramesPerSecond) {
    const std::uint32_t first = last;
    last += frames;
    const double captured = begin + last / kFramesPerSecond;
    std::this_thread::sleep_for(std::chrono::duration<double>(captured - now()));
    const Splats splats = ball(first, last);
    recorder.append(splats.stretch(frames));
    std::printf("{\"begin\": %.6f, \"end\": %.6f, \"captured\": %.6f, \"appended\": %.6f}\n",
                first / kFramesPerSecond, last / kFramesPerSecond, captured, now());
    std::fflush(stdout);
  }
  recorder.close();
}

}  // namespace

int main(int argc, char** argv) {
  const double seconds = argc >= 3 ? std::atof(argv[2]) : 0;
  const double stretch = argc == 4 ? std::atof(argv[3]) : 0.5;
  if (argc > 4 || !(seconds > 0 && seconds <= 3600) || !(stretch >= 0.1 && stretch <= 10)) {
    std::fprintf(stderr, "usage: telepresence_recorder NEW.stgs SECONDS [FRAGMENT_SECONDS]\n");
    return 1;
  }
  try {
    record(argv[1], seconds, stretch);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
