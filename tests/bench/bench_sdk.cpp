// SPDX-License-Identifier: Apache-2.0
// Prints the cost of the C API to an application, as JSON: time per call, time to the first frame,
// and the memory of playing a file within a budget (64 MiB by default).
//   bench_sdk LOCATION [BUDGET_MIB]
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "stgs/stgs.hpp"

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

// Nanoseconds per call: the median of batches.
template <typename Call>
double call_ns(const Call& call) {
  constexpr int kBatches = 51, kCalls = 2000;
  std::vector<double> batches;
  for (int b = 0; b < kBatches; ++b) {
    const auto begin = Clock::now();
    for (int k = 0; k < kCalls; ++k) call();
    batches.push_back(1e9 * seconds_since(begin) / kCalls);
  }
  std::nth_element(batches.begin(), batches.begin() + kBatches / 2, batches.end());
  return batches[kBatches / 2];
}

// Peak resident memory of the process since reset_peak(), MiB.
double resident_peak() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind("VmHWM:", 0) == 0) return std::atof(line.c_str() + 6) / 1024;
  }
  return 0;
}
void reset_peak() {
  std::ofstream("/proc/self/clear_refs") << "5";
}

template <typename Condition>
void wait_for(stgs::Player& player, double now, const Condition& condition) {
  while (!condition(player.update(now)))
    std::this_thread::sleep_for(std::chrono::microseconds(200));
}

nlohmann::json first_frame(const char* path, stgs::Renderer& renderer) {
  const auto begin = Clock::now();
  stgs::Player player;
  player.open(path);
  player.wait_open();
  const double opened = seconds_since(begin);
  const stgs_view view =
      stgs::resized(player.scene().start_view().value_or(stgs::default_view()), 1280, 720);
  wait_for(player, 0, [](const stgs_player_status& s) { return s.ready != 0; });
  const double ready = seconds_since(begin);
  (void)renderer.render_rgba8(player.scene(), 0, view);
  const double rendered = seconds_since(begin);
  wait_for(player, 0, [](const stgs_player_status& s) { return s.is_complete != 0; });
  return {{"opened_ms", 1e3 * opened},
          {"base_ready_ms", 1e3 * ready},
          {"base_rendered_1280x720_ms", 1e3 * rendered},
          {"all_layers_ms", 1e3 * seconds_since(begin)}};
}

nlohmann::json calls(const char* path) {
  stgs::Player player;
  player.open(path);
  player.wait_open();
  wait_for(player, 0, [](const stgs_player_status& s) { return s.is_complete != 0; });
  std::this_thread::sleep_for(std::chrono::seconds(2));  // until prefetching has ended
  return {{"player_update_paused_ns", call_ns([&] { player.update(1); })},
          {"player_next_event_none_ns", call_ns([&] { player.next_event(); })},
          {"player_get_statistics_ns", call_ns([&] { player.statistics(); })},
          {"scene_get_info_ns", call_ns([&] { player.scene().info(); })},
          {"version_ns", call_ns([] { stgs_version(); })}};
}

// Plays the complete file as fast as it loads.
nlohmann::json playing(const char* path, std::uint64_t budget) {
  stgs_player_settings settings = stgs::player_settings();
  settings.memory_budget = budget;
  reset_peak();
  const double before = resident_peak();
  stgs::Player player(settings);
  player.open(path);
  player.wait_open();
  player.play();
  std::uint64_t max_memory = 0, failed_reads = 0;
  int min_layers = 1 << 30;
  double now = 0;
  for (bool ended = false; !ended;) {
    const stgs_player_status status = player.update(now);
    ended = status.state == STGS_PLAYER_ENDED;
    if (status.state == STGS_PLAYER_PLAYING) {
      now += 1.0 / 30;
      min_layers = std::min(min_layers, status.layers);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    max_memory = std::max(max_memory, player.statistics().memory_bytes);
    while (const auto event = player.next_event())
      failed_reads += event->kind == STGS_EVENT_READ_FAILED ? 1 : 0;
  }
  return {{"budget_mib", static_cast<double>(budget) / (1 << 20)},
          {"max_resident_mib", static_cast<double>(max_memory) / (1 << 20)},
          {"max_process_growth_mib", resident_peak() - before},
          {"min_layers", min_layers},
          {"layer_count", player.update(now).layer_count},
          {"failed_reads", failed_reads}};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) {
    std::fprintf(stderr, "usage: bench_sdk LOCATION [BUDGET_MIB]\n");
    return 1;
  }
  try {
    const std::uint64_t budget =
        (argc == 3 ? std::strtoull(argv[2], nullptr, 10) : std::uint64_t{64}) << 20;
    stgs::Scene scene;
    scene.open(argv[1]);
    const stgs_scene_info info = scene.info();
    stgs::Renderer renderer(STGS_BACKEND_CPU);
    nlohmann::json out = {{"file_bytes", info.file_bytes},
                          {"primitives", info.primitives},
                          {"seconds", info.duration_seconds}};
    out["first_frame"] = first_frame(argv[1], renderer);  // first, while the link is idle
    out["playing"] = playing(argv[1], budget);
    out["calls"] = calls(argv[1]);
    std::printf("%s\n", out.dump(2).c_str());
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
