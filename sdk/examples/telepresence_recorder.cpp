// SPDX-License-Identifier: Apache-2.0
// Records a small scene live: a room that stays, and a ball of splats that goes round in it. Each
// stretch of time is appended once it is over, as a capture would be. For each it prints a line of
// JSON with the moments it holds and when it was there, seconds of the machine's monotonic clock.
//
// usage: telepresence_recorder NEW.stgs SECONDS [STRETCH_SECONDS]
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "stgs/format/scene_recorder.h"

namespace {

constexpr double kFramesPerSecond = 30;
constexpr std::uint32_t kLongestFrames = 30 * 3600;  // for which the room stays
constexpr std::uint32_t kRoundFrames = 4 * 30;       // of the ball
constexpr float kTurn = 2 * 3.14159265f, kForEver = 1e6f;

double now() {
  const auto since = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double>(since).count();
}

// A splat at `position` (scene units) that moves by `velocity` a frame, in a shade of one colour.
void add(stgs::Gaussians4D& set, const float (&position)[3], const float (&velocity)[3],
         const float (&colour)[3], float size, float frame, float sigma) {
  constexpr float kSh0 = 0.28209479f;
  for (int c = 0; c < 3; ++c) {
    set.position.push_back(position[c]);
    set.velocity.push_back(velocity[c]);
    set.log_scale.push_back(std::log(size));
    set.sh.push_back((colour[c] - 0.5f) / kSh0);
  }
  set.rotation.insert(set.rotation.end(), {1, 0, 0, 0});
  set.opacity_logit.push_back(3);
  set.time.push_back(frame);
  set.sigma.push_back(sigma);
  set.radius.push_back(sigma);
}

// A floor of tiles, seen from before the first frame to long after the last.
stgs::Gaussians4D room() {
  stgs::Gaussians4D set;
  set.sh_degree = 0;
  for (int x = -20; x <= 20; ++x) {
    for (int z = 0; z <= 40; ++z) {
      const float shade = (x + z) % 2 == 0 ? 0.35f : 0.6f;
      add(set, {0.15f * static_cast<float>(x), 1, 1 + 0.15f * static_cast<float>(z)}, {0, 0, 0},
          {shade, shade, shade}, 0.06f, 0, kForEver);
    }
  }
  return set;
}

// The ball in the frames [first, last): its splats live for a frame or two and follow each other.
stgs::Gaussians4D ball(std::uint32_t first, std::uint32_t last) {
  stgs::Gaussians4D set;
  set.sh_degree = 0;
  for (std::uint32_t frame = first; frame < last; ++frame) {
    const float step = kTurn / kRoundFrames;
    const float angle = step * static_cast<float>(frame % kRoundFrames);
    const float centre[3] = {1.2f * std::cos(angle), 0.3f, 4 + 1.2f * std::sin(angle)};
    const float velocity[3] = {-1.2f * step * std::sin(angle), 0, 1.2f * step * std::cos(angle)};
    for (int i = 0; i < 200; ++i) {  // evenly on a sphere
      const float up = 1 - (static_cast<float>(i) + 0.5f) / 100,
                  around = 2.399963f * static_cast<float>(i);
      const float wide = std::sqrt(1 - up * up);
      const float position[3] = {centre[0] + 0.4f * wide * std::cos(around), centre[1] + 0.4f * up,
                                 centre[2] + 0.4f * wide * std::sin(around)};
      add(set, position, velocity, {0.9f, 0.5f + 0.4f * up, 0.2f}, 0.04f,
          static_cast<float>(frame - first), 0.7f);
    }
  }
  return set;
}

stgs::Status record(const std::string& path, double seconds, double stretch_seconds) {
  stgs::SceneMetadata metadata;
  metadata.time_base = {1, 30};
  metadata.generator = "telepresence_recorder";
  metadata.near_plane = 0.1f;
  stgs::RecordSettings settings;
  settings.write.profile = stgs::Profile::kQuantised;
  settings.sync = false;  // a viewer does not wait for the disk
  STGS_ASSIGN(const auto recorder, stgs::SceneRecorder::create(path, metadata, 0, settings));
  STGS_TRY(recorder->append(room(), 1, {}, kLongestFrames));
  const double begin = now() - 1 / kFramesPerSecond;
  const auto frames = static_cast<std::uint32_t>(std::lround(stretch_seconds * kFramesPerSecond));
  while (recorder->frames() < seconds * kFramesPerSecond) {
    const std::uint32_t first = recorder->frames(), last = first + frames;
    const double captured = begin + last / kFramesPerSecond;
    std::this_thread::sleep_for(std::chrono::duration<double>(captured - now()));
    STGS_TRY(recorder->append(ball(first, last), last));
    std::printf("{\"begin\": %.6f, \"end\": %.6f, \"captured\": %.6f, \"appended\": %.6f}\n",
                first / kFramesPerSecond, last / kFramesPerSecond, captured, now());
    std::fflush(stdout);
  }
  return recorder->close();
}

}  // namespace

int main(int argc, char** argv) {
  const double seconds = argc >= 3 ? std::atof(argv[2]) : 0;
  const double stretch = argc == 4 ? std::atof(argv[3]) : 0.5;
  if (argc > 4 || !(seconds > 0 && seconds <= 3600) || !(stretch >= 0.1 && stretch <= 10)) {
    std::fprintf(stderr, "usage: telepresence_recorder NEW.stgs SECONDS [STRETCH_SECONDS]\n");
    return 1;
  }
  const stgs::Status status = record(argv[1], seconds, stretch);
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.message().c_str());
  return static_cast<int>(status.code());
}
