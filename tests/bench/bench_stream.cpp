// SPDX-License-Identifier: Apache-2.0
// How soon a player shows what it is sent to, from a path, a URL, or a path over a link of a
// bandwidth and a latency that is played here, as a JSON line. A bandwidth of 0: no such link. A
// seek is over when the base of the sought frame is there, decoded; complete: all its layers. With
// memory for little more than what is alive each seek fetches and decodes anew, but for what lasts;
// else later ones find much there. With a backend what has come is drawn as well, at 1920x1080 and
// into the backend's memory: `drawn` is over when that picture is.
//
// usage: bench_stream PLACE [MBIT_A_SECOND LATENCY_MS [SEEKS [MEMORY_MIB [BACKEND]]]]
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "stgs/player/player.h"
#include "stgs/player/renderer.h"
#include "stgs/player/source.h"

using namespace stgs;
using namespace stgs::player;

namespace {

using Clock = std::chrono::steady_clock;
constexpr double kLongest = 20;  // seconds

double seconds() {
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

void sleep_until(double when) {
  std::this_thread::sleep_for(std::chrono::duration<double>(std::max(when - seconds(), 0.0)));
}

// One link for all reads: each waits for the latency, then for its share of the bandwidth.
class LinkedSource final : public ByteSource {
 public:
  LinkedSource(std::unique_ptr<ByteSource> file, double bytes_a_second, double latency)
      : file_(std::move(file)), speed_(bytes_a_second), latency_(latency) {}
  std::uint64_t size() const override { return file_->size(); }
  const std::string& name() const override { return file_->name(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    constexpr std::size_t kPacket = 16384;  // transfers take turns
    sleep_until(seconds() + latency_);
    for (std::size_t done = 0; done < out.size(); done += kPacket) {
      double over;
      {
        const std::lock_guard lock(mutex_);
        const auto bytes = static_cast<double>(std::min(kPacket, out.size() - done));
        free_ = over = std::max(free_, seconds()) + bytes / speed_;
      }
      sleep_until(over);
    }
    return file_->read(offset, out);
  }

 private:
  std::unique_ptr<ByteSource> file_;
  double speed_, latency_;
  mutable std::mutex mutex_;
  mutable double free_ = 0;
};

void check(const Status& status) {
  if (status.ok()) return;
  std::fprintf(stderr, "%s\n", status.message().c_str());
  std::exit(4);
}

struct Times {
  std::vector<double> ready, complete;              // ms
  std::vector<double> drawn_ready, drawn_complete;  // where there is a renderer
};

// Draws the player's moment, where there is something to draw it with, and tells when that is over.
void draw(Player& player, Renderer* renderer, double begin, std::vector<double>& drawn) {
  if (renderer == nullptr) return;
  View view{};
  view.camera.rotation.xx = view.camera.rotation.yy = view.camera.rotation.zz = 1;
  view.camera.fx = view.camera.fy = view.camera.cx = 960;
  view.camera.cy = 540;
  view.camera.width = 1920;
  view.camera.height = 1080;
  view.camera.near_plane = player.timeline().metadata().near_plane;
  check(renderer->draw(player.timeline(), player.seconds(), {view}, nullptr));
  drawn.push_back(1e3 * (seconds() - begin));
}

void wait(Player& player, Renderer* renderer, double begin, Times& times) {
  bool ready = false;
  for (double now = seconds(); now < begin + kLongest; now = seconds()) {
    if (!ready && player.ready()) {
      ready = true;
      times.ready.push_back(1e3 * (now - begin));
      draw(player, renderer, begin, times.drawn_ready);
      now = seconds();
    }
    if (ready && player.layers() == player.layer_count()) {
      times.complete.push_back(1e3 * (now - begin));
      draw(player, renderer, begin, times.drawn_complete);
      return;
    }
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  for (const PlayerEvent& event : player.take_events()) {
    if (!event.message.empty()) std::fprintf(stderr, "%s\n", event.message.c_str());
  }
  const StreamStatistics statistics = player.statistics();
  check(runtime_error("{} of {} layers of {} s have come in {} s, {} bytes fetched, {} held",
                      player.layers(), player.layer_count(), player.seconds(), kLongest,
                      statistics.fetched_bytes, statistics.memory_bytes));
}

double share(std::vector<double> values, double of) {
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(of * static_cast<double>(values.size())));
  return values[std::max<std::size_t>(rank, 1) - 1];
}

// Median and 95th percentile of what was measured; null where nothing was.
nlohmann::json spread(const std::vector<double>& values) {
  if (values.empty()) return nullptr;
  return {{"p50", share(values, 0.5)}, {"p95", share(values, 0.95)}};
}

nlohmann::json first_of(const std::vector<double>& values) {
  return values.empty() ? nlohmann::json() : nlohmann::json(values.front());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 7 || argc == 3) {
    std::fprintf(stderr,
                 "usage: bench_stream PLACE [MBIT_A_SECOND LATENCY_MS [SEEKS [MEMORY_MIB "
                 "[BACKEND]]]]\n");
    return 1;
  }
  const int seeks = argc > 4 ? std::atoi(argv[4]) : 40;
  std::unique_ptr<Renderer> renderer;
  if (argc > 6) {
    auto made = make_renderer(argv[6]);
    check(made.status());
    renderer = std::move(*made);
  }
  const double begin = seconds();
  auto place = open_location(argv[1]);
  check(place.status());
  std::unique_ptr<ByteSource> source = std::move(*place);
  if (argc > 3 && std::atof(argv[2]) > 0) {
    const double speed = std::atof(argv[2]) * 1e6 / 8, latency = std::atof(argv[3]) * 1e-3;
    source = std::make_unique<LinkedSource>(std::move(source), speed, latency);
  }
  PlayerSettings settings;
  if (argc > 5) settings.memory_budget = std::strtoull(argv[5], nullptr, 10) << 20;
  auto player = Player::from_source(std::move(source), settings);
  check(player.status());
  const double opened = seconds();
  Times first, sought;
  wait(**player, renderer.get(), begin, first);
  std::mt19937 random(1);
  const std::uint32_t frames = (*player)->timeline().metadata().frames;
  for (int k = 0; k < seeks; ++k) {
    const double start = seconds();
    check((*player)->seek_frame(static_cast<std::uint32_t>(random() % frames)));
    wait(**player, renderer.get(), start, sought);
  }
  const StreamStatistics statistics = (*player)->statistics();
  const nlohmann::json out = {{"open_ms", 1e3 * (opened - begin)},
                              {"base_ms", first_of(first.ready)},
                              {"base_drawn_ms", first_of(first.drawn_ready)},
                              {"complete_ms", first_of(first.complete)},
                              {"complete_drawn_ms", first_of(first.drawn_complete)},
                              {"seeks", seeks},
                              {"seek_ms", spread(sought.ready)},
                              {"seek_drawn_ms", spread(sought.drawn_ready)},
                              {"seek_complete_ms", spread(sought.complete)},
                              {"seek_complete_drawn_ms", spread(sought.drawn_complete)},
                              {"fetched_bytes", statistics.fetched_bytes},
                              {"memory_bytes", statistics.memory_bytes}};
  std::printf("%s\n", out.dump().c_str());
  return 0;
}
