// SPDX-License-Identifier: Apache-2.0
// Plays a scene for test_play.py and prints the results as JSON.
//
// usage: play_probe make FILE
//        play_probe play LOCATION LOCAL SECONDS [SEEK...]
//   Plays LOCATION in a loop at 30 fps for SECONDS of wall-clock time and seeks to each time SEEK,
//   0.3 s apart. Then pauses, waits up to 5 s for all layers, and compares the active primitives
//   and a rendered frame with LOCAL, the same file on a disk. A read without data is retried after
//   STALL_SECONDS of the environment, 1 if unset.
//        play_probe seek LOCATION TIME...
//   Shows the first frame. Half a second after it is complete, seeks to each TIME, a second apart,
//   and waits up to 8 s until the last is ready. Has one read in flight at a time.
//        play_probe follow LOCATION SECONDS
//   Follows a recording until it ends, for at most SECONDS. STALL_SECONDS as above.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "../fixtures/scene_fixture.h"
#include "stgs/player/player.h"
#include "stgs/player/renderer.h"

using namespace stgs;
using namespace stgs::player;
using Json = nlohmann::json;
using Clock = std::chrono::steady_clock;

namespace {

constexpr double kTick = 1.0 / 30, kBetweenSeeks = 0.3, kMaxWait = 5;

double seconds() {
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

[[noreturn]] void fail(const Status& status) {
  std::printf("%s\n", Json{{"error", status.message()}}.dump().c_str());
  std::exit(0);
}

void make(const std::string& path) {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.chunk_seconds = 0.25;
  const Status status = write_scene(path, testing::random_scene(20000, 2, 90, 9), settings);
  if (!status.ok()) fail(status);
}

const char* name_of(PlayerEvent::Kind kind) {
  constexpr const char* kNames[] = {"buffering", "resumed", "looped",      "ended",
                                    "layers",    "retry",   "read_failed", "damaged",
                                    "replaced",  "stalled", "skipped",     "finished"};
  return kNames[static_cast<int>(kind)];
}

// The ids of the candidates at a time.
std::vector<std::uint32_t> candidates_at(Timeline& timeline, double time) {
  const auto active = timeline.at(time);
  if (!active.ok()) fail(active.status());
  std::vector<std::uint32_t> ids;
  for (const auto& part : active->segments) {
    for (const std::uint32_t i : *part.candidates) ids.push_back(part.id_base + i);
  }
  return ids;
}

// Renders a small frame of the scene.
Frame render_frame(Renderer& renderer, Timeline& timeline, double time) {
  View view{};
  view.camera.rotation = math::rotation_of({1, 0, 0, 0});
  view.camera.width = 64;
  view.camera.height = 48;
  view.camera.fx = view.camera.fy = 60;
  view.camera.cx = 32;
  view.camera.cy = 24;
  view.camera.near_plane = 0.2f;
  std::vector<Frame> frames;
  if (const Status status = renderer.render(timeline, time, {view}, frames, nullptr);
      !status.ok()) {
    fail(status);
  }
  return frames[0];
}

class Session {
 public:
  Session(Player& player, double begin)
      : player_(player), begin_(begin), renderer_(std::move(*make_renderer("cpu"))) {}

  void play(double duration, const std::vector<double>& seeks) {
    player_.set_loop(true);
    player_.play();
    std::size_t sought = 0;
    for (double now = seconds(); now < begin_ + duration; now = seconds()) {
      if (sought < seeks.size() && now > begin_ + kBetweenSeeks * static_cast<double>(sought + 1)) {
        if (Status status = player_.seek(seeks[sought++]); !status.ok()) fail(status);
      }
      tick(now);
    }
  }
  // Follows a recording; reports the joining time and which thirds of a second were shown.
  Json follow(double duration) {
    Json out{{"growing", player_.live().growing}, {"edge", player_.live().edge_seconds}};
    player_.play();
    std::set<int> shown;
    double max_latency = 0;
    for (double now = seconds(); now < begin_ + duration; now = seconds()) {
      tick(now);
      if (!player_.ready()) continue;
      if (shown.empty()) out["joined"] = player_.seconds();
      shown.insert(static_cast<int>(3 * player_.seconds() + 1e-6));
      const LiveState live = player_.live();
      if (live.growing) max_latency = std::max(max_latency, live.latency_seconds);
      if (player_.state() == PlayerState::kEnded) break;
    }
    out["shown"] = shown;
    out["max_latency"] = max_latency;
    out["ended"] = player_.state() == PlayerState::kEnded;
    out["time"] = player_.seconds();
    out["longest_call"] = longest_call_;
    out["counts"] = counts_;
    out["messages"] = messages_;
    return out;
  }
  void load_all() {
    player_.pause();
    const double end = seconds() + kMaxWait;
    while (seconds() < end && player_.layers() < player_.layer_count()) tick(seconds());
  }
  Json report(Timeline& local) {
    const StreamStatistics statistics = player_.statistics();
    return {{"first_ready", first_ready_},
            {"longest_call", longest_call_},
            {"frames", frames_},
            {"frames_ready", ready_},
            {"layers", player_.layers()},
            {"layer_count", player_.layer_count()},
            {"min_layers", min_layers_},
            {"same", candidates_at(player_.timeline(), player_.seconds()) ==
                         candidates_at(local, player_.seconds())},
            {"same_frame",
             render_frame(*renderer_, player_.timeline(), player_.seconds()).colour.data ==
                 render_frame(*renderer_, local, player_.seconds()).colour.data},
            {"bytes_per_second", statistics.bytes_per_second},
            {"fetched_bytes", statistics.fetched_bytes},
            {"counts", counts_},
            {"messages", messages_}};
  }

 private:
  void tick(double now) {
    const double time = player_.advance(now);
    candidates_at(player_.timeline(), time);
    const bool ready = player_.ready();
    longest_call_ = std::max(longest_call_, seconds() - now);
    (void)render_frame(*renderer_, player_.timeline(), time);  // with the available layers
    if (ready && first_ready_ < 0) first_ready_ = now - begin_;
    ++frames_;
    ready_ += ready ? 1 : 0;
    if (ready) min_layers_ = std::min(min_layers_, player_.layers());
    for (const PlayerEvent& event : player_.take_events()) {
      counts_[name_of(event.kind)] = counts_.value(name_of(event.kind), 0) + 1;
      if (!event.message.empty()) messages_.push_back(event.message);
    }
    std::this_thread::sleep_for(std::chrono::duration<double>(kTick));
  }

  Player& player_;
  double begin_, first_ready_ = -1, longest_call_ = 0;
  std::unique_ptr<Renderer> renderer_;
  int frames_ = 0, ready_ = 0, min_layers_ = 1000;
  Json counts_ = Json::object(), messages_ = Json::array();
};

PlayerSettings quick_retries() {
  PlayerSettings settings;
  settings.retry_seconds = 0.1;
  settings.http.max_attempts = 2;
  settings.http.backoff_seconds = 0.02;
  const char* stall = std::getenv("STALL_SECONDS");
  settings.http.stall_seconds = stall ? std::atof(stall) : 1;
  settings.http.head_bytes = 4096;
  return settings;
}

void seek(int argc, char** argv) {
  PlayerSettings settings;
  settings.max_reads_in_flight = 1;
  settings.prefetch_seconds = 0.1;
  settings.resume_seconds = 0.1;
  settings.http.head_bytes = 4096;
  auto player = Player::open(argv[2], settings);
  if (!player.ok()) fail(player.status());
  const auto wait = [&](double duration, const std::function<bool()>& until) {
    const double begin = seconds();
    while (seconds() < begin + duration && !until()) {
      (void)(*player)->advance(seconds());
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return seconds() - begin;
  };
  Json out{{"first", wait(8, [&] { return (*player)->is_complete(); })}, {"took", Json::array()}};
  (void)wait(0.5, [] { return false; });
  for (int k = 3; k < argc; ++k) {
    if (const Status status = (*player)->seek(std::atof(argv[k])); !status.ok()) fail(status);
    out["took"].push_back(wait(k + 1 < argc ? 1 : 8, [&] { return (*player)->ready(); }));
  }
  std::printf("%s\n", out.dump().c_str());
}

void follow(char** argv) {
  PlayerSettings settings = quick_retries();
  settings.live.latency_seconds = 0;
  settings.live.stall_seconds = 1;
  const double begin = seconds();
  auto player = Player::open(argv[2], settings);
  if (!player.ok()) fail(player.status());
  Session session(**player, begin);
  std::printf("%s\n", session.follow(std::atof(argv[3])).dump().c_str());
}

void play(int argc, char** argv) {
  const PlayerSettings settings = quick_retries();
  const double begin = seconds();
  auto player = Player::open(argv[2], settings);
  if (!player.ok()) fail(player.status());
  auto local = Timeline::open(argv[3]);
  if (!local.ok()) fail(local.status());
  std::vector<double> seeks;
  for (int k = 5; k < argc; ++k) seeks.push_back(std::atof(argv[k]));
  Session session(**player, begin);
  session.play(std::atof(argv[4]), seeks);
  session.load_all();
  Json report = session.report(**local);
  const double closing = seconds();
  player->reset();
  report["closed_in"] = seconds() - closing;
  std::printf("%s\n", report.dump().c_str());
}

}  // namespace

int main(int argc, char** argv) {
  const std::string verb = argc > 1 ? argv[1] : "";
  if (verb == "make" && argc == 3) {
    make(argv[2]);
  } else if (verb == "play" && argc >= 5) {
    play(argc, argv);
  } else if (verb == "seek" && argc >= 4) {
    seek(argc, argv);
  } else if (verb == "follow" && argc == 4) {
    follow(argv);
  } else {
    std::fprintf(stderr,
                 "usage: play_probe make FILE | play LOCATION LOCAL SECONDS [SEEK...] | seek "
                 "LOCATION TIME... | follow LOCATION SECONDS\n");
    return 1;
  }
  return 0;
}
