// SPDX-License-Identifier: Apache-2.0
// Joins a recording while it is made, follows its live edge, and draws what it sees, without a
// window. At the end of the recording, or after SECONDS, it prints JSON: what was shown when, in
// seconds of the machine's monotonic clock, how long joining took, and what happened meanwhile.
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

constexpr double kDisplay = 1.0 / 60;  // seconds between pictures
constexpr double kReopen = 0.2;        // seconds until a recording that has gone is asked for again

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
  double moment, at;
};

class Viewer {
 public:
  explicit Viewer(const char* place) : place_(place), begun_(now()) {
    view_.near_plane = 0.1f;
    view_ = stgs::resized(view_, 160, 90);
    open();
  }

  // Draws pictures until the recording has ended.
  void watch(double seconds) {
    while (now() < begun_ + seconds) {
      const double picture_at = now();
      const stgs_player_status status = player_->update(picture_at);
      if (note_events()) {  // `status` is of a recording that has gone
        std::this_thread::sleep_for(std::chrono::duration<double>(kReopen));
        open();
        continue;
      }
      if (status.state == STGS_PLAYER_ENDED) return;
      if (status.state >= STGS_PLAYER_PAUSED && status.ready != 0) draw(status.seconds);
      std::this_thread::sleep_for(std::chrono::duration<double>(picture_at + kDisplay - now()));
    }
  }

  void print() const {
    std::printf("{\"opened\": %.6f, \"joined\": %s, \"shown\": [", begun_,
                shown_.empty() ? "null" : std::to_string(shown_.front().at - begun_).c_str());
    for (std::size_t i = 0; i < shown_.size(); ++i) {
      std::printf("%s[%.6f, %.6f]", i > 0 ? ", " : "", shown_[i].moment, shown_[i].at);
    }
    std::printf("], \"max_latency\": %.6f, \"events\": {", most_behind_);
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
    settings.live_latency_seconds = 0;  // as near to the edge as the recording lets it be
    player_ = std::make_unique<stgs::Player>(settings);
    player_->open(place_);
    player_->play();
  }

  // Whether another recording has its place now, which may have only just begun.
  bool note_events() {
    bool gone = false;
    while (const auto event = player_->next_event()) {
      ++events_[name_of(event->kind)];
      if (!event->message.empty()) std::fprintf(stderr, "%s\n", event->message.c_str());
      const bool failed = event->kind == STGS_EVENT_FAILED;
      if (failed && shown_.empty()) throw std::runtime_error(event->message);
      gone = gone || failed || event->kind == STGS_EVENT_REPLACED;
    }
    return gone;
  }

  void draw(double moment) {
    renderer_.render_rgba8(player_->scene(), moment, view_);
    shown_.push_back({moment, now()});
    const stgs_player_live live = player_->live();
    if (live.growing != 0 && live.latency_seconds > most_behind_)
      most_behind_ = live.latency_seconds;
  }

  const std::string place_;
  const double begun_;
  std::unique_ptr<stgs::Player> player_;
  stgs::Renderer renderer_{STGS_BACKEND_CPU};
  stgs_view view_ = stgs::default_view();
  std::vector<Shown> shown_;
  double most_behind_ = 0;
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
