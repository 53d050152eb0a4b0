// SPDX-License-Identifier: Apache-2.0
// How soon a player shows what it is sent to, from a path, a URL, or a path over a link of a
// bandwidth and a latency that is played here, as a JSON line. A bandwidth of 0: no such link. A
// seek is over when the base of the sought frame is there, decoded; complete: all its layers. With
// memory for little more than what is alive each seek fetches and decodes anew, but for what lasts;
// else later ones find much there.
//
// usage: bench_stream PLACE [MBIT_A_SECOND LATENCY_MS [SEEKS [MEMORY_MIB]]]
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <random>
#include <thread>

#include "stgs/player/player.h"
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
  std::vector<double> ready, complete;  // ms
};

void wait(Player& player, double begin, Times& times) {
  double ready = -1;
  for (double now = seconds(); now < begin + kLongest; now = seconds()) {
    if (ready < 0 && player.ready()) ready = now;
    if (ready >= 0 && player.layers() == player.layers_of_file()) {
      times.ready.push_back(1e3 * (ready - begin));
      times.complete.push_back(1e3 * (now - begin));
      return;
    }
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  for (const PlayerEvent& event : player.take_events()) {
    if (!event.message.empty()) std::fprintf(stderr, "%s\n", event.message.c_str());
  }
  const StreamStatistics statistics = player.statistics();
  check(runtime_error("{} of {} layers of {} s have come in {} s, {} bytes fetched, {} held",
                      player.layers(), player.layers_of_file(), player.seconds(), kLongest,
                      statistics.fetched_bytes, statistics.memory_bytes));
}

double share(std::vector<double> values, double of) {
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(of * static_cast<double>(values.size())));
  return values[std::max<std::size_t>(rank, 1) - 1];
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 6 || argc == 3) {
    std::fprintf(stderr,
                 "usage: bench_stream PLACE [MBIT_A_SECOND LATENCY_MS [SEEKS [MEMORY_MIB]]]\n");
    return 1;
  }
  const int seeks = argc > 4 ? std::atoi(argv[4]) : 40;
  const double begin = seconds();
  auto place = open_place(argv[1]);
  check(place.status());
  std::unique_ptr<ByteSource> source = std::move(*place);
  if (argc > 3 && std::atof(argv[2]) > 0) {
    const double speed = std::atof(argv[2]) * 1e6 / 8, latency = std::atof(argv[3]) * 1e-3;
    source = std::make_unique<LinkedSource>(std::move(source), speed, latency);
  }
  PlayerSettings settings;
  if (argc > 5) settings.memory_budget = std::strtoull(argv[5], nullptr, 10) << 20;
  auto player = Player::over(std::move(source), settings);
  check(player.status());
  const double opened = seconds();
  Times first, sought;
  wait(**player, begin, first);
  std::mt19937 random(1);
  const std::uint32_t frames = (*player)->timeline().metadata().frames;
  for (int k = 0; k < seeks; ++k) {
    const double start = seconds();
    check((*player)->seek_frame(static_cast<std::uint32_t>(random() % frames)));
    wait(**player, start, sought);
  }
  const StreamStatistics statistics = (*player)->statistics();
  std::printf(
      "{\"open_ms\": %.1f, \"base_ms\": %.1f, \"complete_ms\": %.1f, \"seeks\": %d, "
      "\"seek_ms\": {\"p50\": %.1f, \"p95\": %.1f}, \"seek_complete_ms\": {\"p50\": %.1f, "
      "\"p95\": %.1f}, \"fetched_bytes\": %llu, \"memory_bytes\": %llu}\n",
      1e3 * (opened - begin), first.ready[0], first.complete[0], seeks, share(sought.ready, 0.5),
      share(sought.ready, 0.95), share(sought.complete, 0.5), share(sought.complete, 0.95),
      static_cast<unsigned long long>(statistics.fetched_bytes),
      static_cast<unsigned long long>(statistics.memory_bytes));
  return 0;
}
