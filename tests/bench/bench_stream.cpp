// SPDX-License-Identifier: Apache-2.0
// Prints the time that a player takes to open and to seek, as a JSON line, for a path, a URL, or a
// path behind a simulated link of limited bandwidth and latency (bandwidth 0: no link).
//
// - A seek ends when the base layer of its frame is decoded; `complete`: all layers.
// - With memory for little more than the active primitives, each seek fetches and decodes all but
//   the persistent content again. With more memory, later seeks find segments resident.
// - With a backend the frame is rendered too, at 1920x1080 into memory of the backend: `rendered`.
//
// usage: bench_stream LOCATION [MBIT_PER_SECOND LATENCY_MS [SEEKS [MEMORY_MIB [BACKEND]]]]
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
constexpr double kMaxWait = 20;  // seconds

double seconds() {
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

void sleep_until(double when) {
  std::this_thread::sleep_for(std::chrono::duration<double>(std::max(when - seconds(), 0.0)));
}

// All reads share one link: each waits for the latency, then for its part of the bandwidth.
class SimulatedLink final : public ByteSource {
 public:
  SimulatedLink(std::unique_ptr<ByteSource> file, double bytes_per_second, double latency)
      : file_(std::move(file)), speed_(bytes_per_second), latency_(latency) {}
  std::uint64_t size() const override { return file_->size(); }
  const std::string& name() const override { return file_->name(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    constexpr std::size_t kPacket = 16384;  // transfers take turns
    sleep_until(seconds() + latency_);
    for (std::size_t done = 0; done < out.size(); done += kPacket) {
      double end;
      {
        const std::lock_guard lock(mutex_);
        const auto bytes = static_cast<double>(std::min(kPacket, out.size() - done));
        next_free_ = end = std::max(next_free_, seconds()) + bytes / speed_;
      }
      sleep_until(end);
    }
    return file_->read(offset, out);
  }

 private:
  std::unique_ptr<ByteSource> file_;
  double speed_, latency_;
  mutable std::mutex mutex_;
  mutable double next_free_ = 0;
};

void check(const Status& status) {
  if (status.ok()) return;
  std::fprintf(stderr, "%s\n", status.message().c_str());
  std::exit(4);
}

struct Times {
  std::vector<double> ready, complete;                   // ms
  std::vector<double> rendered_base, rendered_complete;  // with a renderer only
};

// Renders the player's current frame if there is a renderer, and appends the time since `begin`.
void render(Player& player, Renderer* renderer, double begin, std::vector<double>& rendered) {
  if (renderer == nullptr) return;
  View view{};
  view.camera.rotation.xx = view.camera.rotation.yy = view.camera.rotation.zz = 1;
  view.camera.fx = view.camera.fy = view.camera.cx = 960;
  view.camera.cy = 540;
  view.camera.width = 1920;
  view.camera.height = 1080;
  view.camera.near_plane = player.timeline().metadata().near_plane;
  check(renderer->draw(player.timeline(), player.seconds(), {view}, nullptr));
  rendered.push_back(1e3 * (seconds() - begin));
}

void wait(Player& player, Renderer* renderer, double begin, Times& times) {
  bool ready = false;
  for (double now = seconds(); now < begin + kMaxWait; now = seconds()) {
    if (!ready && player.ready()) {
      ready = true;
      times.ready.push_back(1e3 * (now - begin));
      render(player, renderer, begin, times.rendered_base);
      now = seconds();
    }
    if (ready && player.layers() == player.layer_count()) {
      times.complete.push_back(1e3 * (now - begin));
      render(player, renderer, begin, times.rendered_complete);
      return;
    }
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  for (const PlayerEvent& event : player.take_events()) {
    if (!event.message.empty()) std::fprintf(stderr, "%s\n", event.message.c_str());
  }
  const StreamStatistics statistics = player.statistics();
  check(runtime_error("{} of {} layers at {} s loaded within {} s ({} bytes fetched, {} resident)",
                      player.layers(), player.layer_count(), player.seconds(), kMaxWait,
                      statistics.fetched_bytes, statistics.memory_bytes));
}

double percentile(std::vector<double> values, double fraction) {
  std::sort(values.begin(), values.end());
  const auto rank =
      static_cast<std::size_t>(std::ceil(fraction * static_cast<double>(values.size())));
  return values[std::max<std::size_t>(rank, 1) - 1];
}

// Median and 95th percentile; null if there are no values.
nlohmann::json percentiles(const std::vector<double>& values) {
  if (values.empty()) return nullptr;
  return {{"p50", percentile(values, 0.5)}, {"p95", percentile(values, 0.95)}};
}

nlohmann::json first_of(const std::vector<double>& values) {
  return values.empty() ? nlohmann::json() : nlohmann::json(values.front());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 7 || argc == 3) {
    std::fprintf(stderr,
                 "usage: bench_stream LOCATION [MBIT_PER_SECOND LATENCY_MS [SEEKS [MEMORY_MIB "
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
  auto opened_source = open_location(argv[1]);
  check(opened_source.status());
  std::unique_ptr<ByteSource> source = std::move(*opened_source);
  if (argc > 3 && std::atof(argv[2]) > 0) {
    const double speed = std::atof(argv[2]) * 1e6 / 8, latency = std::atof(argv[3]) * 1e-3;
    source = std::make_unique<SimulatedLink>(std::move(source), speed, latency);
  }
  PlayerSettings settings;
  if (argc > 5) settings.memory_budget = std::strtoull(argv[5], nullptr, 10) << 20;
  auto player = Player::from_source(std::move(source), settings);
  check(player.status());
  const double opened = seconds();
  Times open_times, seek_times;
  wait(**player, renderer.get(), begin, open_times);
  std::mt19937 random(1);
  const std::uint32_t frames = (*player)->timeline().metadata().frames;
  for (int k = 0; k < seeks; ++k) {
    const double start = seconds();
    check((*player)->seek_frame(static_cast<std::uint32_t>(random() % frames)));
    wait(**player, renderer.get(), start, seek_times);
  }
  const StreamStatistics statistics = (*player)->statistics();
  const nlohmann::json out = {
      {"open_ms", 1e3 * (opened - begin)},
      {"base_ms", first_of(open_times.ready)},
      {"base_rendered_ms", first_of(open_times.rendered_base)},
      {"complete_ms", first_of(open_times.complete)},
      {"complete_rendered_ms", first_of(open_times.rendered_complete)},
      {"seeks", seeks},
      {"seek_ms", percentiles(seek_times.ready)},
      {"seek_rendered_ms", percentiles(seek_times.rendered_base)},
      {"seek_complete_ms", percentiles(seek_times.complete)},
      {"seek_complete_rendered_ms", percentiles(seek_times.rendered_complete)},
      {"fetched_bytes", statistics.fetched_bytes},
      {"memory_bytes", statistics.memory_bytes}};
  std::printf("%s\n", out.dump().c_str());
  return 0;
}
