// SPDX-License-Identifier: Apache-2.0
// Joins a recording while it grows, follows its live edge and renders it, without a window. At the
// end of the recording, or after SECONDS, prints JSON: which clip time was shown when (seconds of
// the monotonic clock), how long joining took, the largest latency, and the number of events.
//
// usage: telepresence_viewer FILE|URL SECONDS
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "stgs/stgs.hpp"

namespace {

constexpr double kFrameSeconds = 1.0 / 60;  // display interval
constexpr double kReopenSeconds = 0.2;      // delay before a replaced recording is opened again

double now() {
  const auto since = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double>(since).count();
}

const char* name_of(stgs_event_kind kind) {
  switch (kind) {
    case STGS_EVENT_FAILED:
      return "failed";
    case STGS_EVENT_BUFFERING:
      return "buffering";
    case STGS_EVENT_RESUMED:
      return "resumed";
    case STGS_EVENT_READ_FAILED:
      return "read_failed";
    case STGS_EVENT_DAMAGED:
      return "damaged";
    case STGS_EVENT_REPLACED:
      return "replaced";
    case STGS_EVENT_STALLED:
      return "stalled";
    case STGS_EVENT_SKIPPED:
      return "skipped";
    case STGS_EVENT_FINISHED:
      return "finished";
    case STGS_EVENT_ENDED:
      return "ended";
    default:
      return "other";
  }
}

struct Shown {
  double seconds;  // clip time
  double at;       // monotonic clock
};

class Viewer {
 public:
  explicit Viewer(const char* location) : location_(location), begun_(now()) {
    view_.near_plane = 0.1f;
    view_ = stgs::resized(view_, 160, 90);
    open();
  }

  // Renders frames until the recording ends.
  void watch(double seconds) {
    while (now() < begun_ + seconds) {
      const double frame_begin = now();
      const stgs_player_status status = player_->update(frame_begin);
      if (handle_events()) {  // `status` belongs to the old recording
        std::this_thread::sleep_for(std::chrono::duration<double>(kReopenSeconds));
        open();
        continue;
      }
      if (status.state == STGS_PLAYER_ENDED) return;
      if (status.state >= STGS_PLAYER_PAUSED && status.ready != 0) render(status.seconds);
      std::this_thread::sleep_for(
          std::chrono::duration<double>(frame_begin + kFrameSeconds - now()));
    }
  }

  void print() const {
    std::printf("{\"opened\": %.6f, \"joined\": %s, \"shown\": [", begun_,
                shown_.empty() ? "null" : std::to_string(shown_.front().at - begun_).c_str());
    for (std::size_t i = 0; i < shown_.size(); ++i) {
      std::printf("%s[%.6f, %.6f]", i > 0 ? ", " : "", shown_[i].seconds, shown_[i].at);
    }
    std::printf("], \"max_latency\": %.6f, \"events\": {", max_latency_);
    const char* comma = "";
    for (const auto& [name, count] : events_) {
      std::printf("%s\"%s\": %d", comma, name.c_str(), count);
      comma = ", ";
    }
    std::printf("}}\n");
  }

 private:
  void open() {
    stgs_player_settings settings = stgs::player_settings();
    settings.live_latency_seconds = 0;  // as close to the edge as the recording permits
    player_ = std::make_unique<stgs::Player>(settings);
    player_->open(location_);
    player_->play();
  }

  // Handles queued events. Returns whether the recording failed to open or was replaced, perhaps by
  // one that has only just begun.
  bool handle_events() {
    bool is_gone = false;
    while (const auto event = player_->next_event()) {
      ++events_[name_of(event->kind)];
      if (!event->message.empty()) std::fprintf(stderr, "%s\n", event->message.c_str());
      const bool failed = event->kind == STGS_EVENT_FAILED;
      if (failed && shown_.empty()) throw std::runtime_error(event->message);
      is_gone = is_gone || failed || event->kind == STGS_EVENT_REPLACED;
    }
    return is_gone;
  }

  void render(double seconds) {
    renderer_.render_rgba8(player_->scene(), seconds, view_);
    shown_.push_back({seconds, now()});
    const stgs_player_live live = player_->live();
    if (live.growing != 0 && live.latency_seconds > max_latency_)
      max_latency_ = live.latency_seconds;
  }

  const std::string location_;
  const double begun_;
  std::unique_ptr<stgs::Player> player_;
  stgs::Renderer renderer_{STGS_BACKEND_CPU};
  stgs_view view_ = stgs::default_view();
  std::vector<Shown> shown_;
  double max_latency_ = 0;
  std::map<std::string, int> events_;
};

}  // namespace

int main(int argc, char** argv) {
  const double seconds = argc == 3 ? std::atof(argv[2]) : 0;
  if (!(seconds > 0 && seconds <= 3600)) {
    std::fprintf(stderr, "usage: telepresence_viewer FILE|URL SECONDS\n");
    return 1;
  }
  try {
    Viewer viewer(argv[1]);
    viewer.watch(seconds);
    viewer.print();
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
