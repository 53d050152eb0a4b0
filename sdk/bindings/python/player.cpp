// SPDX-License-Identifier: Apache-2.0
// Plays a scene while its data is still arriving.
#include <pybind11/stl.h>

#include <array>
#include <chrono>
#include <set>

#include "classes.h"

namespace stgs::python {
namespace {

// Index: stgs_player_state.
constexpr std::array kStates = {"closed", "opening", "paused", "playing", "buffering", "ended"};
// Index: stgs_event_kind.
constexpr std::array kEvents = {"none",    "opened",   "failed",  "buffering", "resumed",
                                "looped",  "ended",    "layers",  "retry",     "read_failed",
                                "damaged", "replaced", "stalled", "skipped",   "finished"};

template <typename Names>
const char* name_of(const Names& names, std::int32_t index) {
  const auto i = static_cast<std::size_t>(index);
  return i < names.size() ? names[i] : "unknown";
}

// An stgs_player_event that owns its message.
struct Event {
  stgs_player_event event = sized<stgs_player_event>();
  std::string message;
};

class Player {
 public:
  Player(const py::object& source, const stgs_player_settings& settings)
      : log_(std::make_shared<Log>()), source_(source), handle_("player", log_) {
    description_ = source_->description();
    stgs_player_settings own = settings;
    own.log = Log::append;
    own.log_user = log_.get();
    stgs_player* created = nullptr;
    if (const stgs_result result = stgs_player_create(&own, &created); result != STGS_OK)
      throw Failure(result, "a setting is out of range");
    handle_.set(created);
    scene_.emplace(stgs_player_scene(created), "of a player", log_);
    run([&](stgs_player* p) {
      return source_->open([&](const char* location) { return stgs_player_open(p, location); },
                           [&](const void* data, std::size_t size) {
                             return stgs_player_open_memory(p, data, size);
                           });
    });
  }
  // NOLINTNEXTLINE(bugprone-exception-escape): as ~Handle
  ~Player() { close(); }
  Player(const Player&) = delete;
  Player& operator=(const Player&) = delete;

  // Ends reads and threads, which may block briefly.
  void close() {
    if (scene_) {
      handle_.close(scene_->handle());
    } else {
      handle_.close();
    }
    source_.reset();
  }
  bool is_closed() { return handle_.is_closed(); }
  const std::string& description() const { return description_; }

  // Runs call(player) and throws Failure unless it returns STGS_OK.
  template <typename Call>
  void run(Call&& call) {
    handle_.run(std::forward<Call>(call));
  }

  void wait_open() {
    run([&](stgs_player* p) {
      const stgs_result result = stgs_player_wait_open(p);
      is_open_ = is_open_ || result == STGS_OK;
      return result;
    });
  }
  stgs_player_status update(std::optional<double> now) {
    auto status = sized<stgs_player_status>();
    const std::chrono::duration<double> clock = std::chrono::steady_clock::now().time_since_epoch();
    run([&](stgs_player* p) {
      const stgs_result result = stgs_player_update(p, now.value_or(clock.count()), &status);
      if (result == STGS_OK) remember(status);
      return result;
    });
    return status;
  }
  stgs_player_status seek_and_wait(double seconds, double timeout) {
    auto status = sized<stgs_player_status>();
    run([&](stgs_player* p) {
      const stgs_result result = stgs_player_seek_and_wait(p, seconds, timeout, &status);
      if (result == STGS_OK) remember(status);
      return result;
    });
    return status;
  }
  // Another thread may use the scene once an update has reported an open state.
  Scene& scene() {
    bool is_open = false;
    run([&](stgs_player*) {
      is_open = is_open_;
      return STGS_OK;
    });
    if (!is_open) {
      throw Failure(STGS_ERROR_STATE,
                    "the file of the player is not open; call wait_open() or update() first");
    }
    return *scene_;
  }
  std::vector<Event> events() {
    std::vector<Event> out;
    run([&](stgs_player* p) -> stgs_result {
      for (;;) {
        Event one;
        if (const stgs_result result = stgs_player_next_event(p, &one.event); result != STGS_OK) {
          return result;
        }
        if (one.event.kind == STGS_EVENT_NONE) return STGS_OK;
        one.message = one.event.message;
        out.push_back(std::move(one));
      }
    });
    return out;
  }
  std::vector<std::pair<double, double>> buffered() {
    std::vector<stgs_time_range> ranges(8);
    std::uint32_t count = 0;
    run([&](stgs_player* p) {
      for (;;) {
        const auto capacity = static_cast<std::uint32_t>(ranges.size());
        const stgs_result result = stgs_player_get_buffered(p, ranges.data(), capacity, &count);
        if (result != STGS_OK || count <= capacity) return result;
        ranges.resize(count);
      }
    });
    std::vector<std::pair<double, double>> out;
    for (std::uint32_t i = 0; i < count; ++i) out.emplace_back(ranges[i].begin, ranges[i].end);
    return out;
  }
  stgs_player_statistics statistics() {
    auto out = sized<stgs_player_statistics>();
    run([&](stgs_player* p) { return stgs_player_get_statistics(p, &out); });
    return out;
  }

  stgs_player_live live() {
    auto out = sized<stgs_player_live>();
    run([&](stgs_player* p) { return stgs_player_get_live(p, &out); });
    if (out.following != 0) rate_ = 1;  // following resets the rate
    return out;
  }

  void set_rate(double rate) {
    run([&](stgs_player* p) { return stgs_player_set_rate(p, rate); });
    rate_ = rate;
  }
  double rate() {
    live();
    return rate_;
  }
  void set_loop(bool loop) {
    run([&](stgs_player* p) { return stgs_player_set_loop(p, loop ? 1 : 0); });
    loop_ = loop;
  }
  bool loop() const { return loop_; }
  // Returns the status of the last update.
  stgs_player_status last_status() {
    auto out = sized<stgs_player_status>();
    run([&](stgs_player*) {
      out = last_status_;
      return STGS_OK;
    });
    return out;
  }

 private:
  // With the lock of the player.
  void remember(const stgs_player_status& status) {
    last_status_ = status;
    is_open_ = is_open_ || status.state >= STGS_PLAYER_PAUSED;
  }

  std::shared_ptr<Log> log_;
  std::string description_;
  std::optional<Source> source_;  // must outlive the player
  PlayerHandle handle_;
  std::optional<Scene> scene_;
  bool is_open_ = false;
  stgs_player_status last_status_{sizeof(stgs_player_status), STGS_PLAYER_OPENING, 0, 0, 0, 0, 0};
  double rate_ = 1;
  bool loop_ = false;
};

// Returns the defaults with the settings given by name.
stgs_player_settings settings_of(const py::kwargs& given) {
  stgs_player_settings out;
  stgs_player_settings_defaults(&out, sizeof out);
  std::set<std::string> known;
  const auto set = [&](const char* name, auto member) {
    known.insert(name);
    if (!given.contains(name)) return;
    try {
      out.*member = given[name].cast<std::decay_t<decltype(out.*member)>>();
    } catch (const py::cast_error&) {
      throw py::type_error(std::string("Player: ") + name + " must be a number in range, not " +
                           py::repr(given[name]).cast<std::string>());
    }
  };
  using Settings = stgs_player_settings;
  set("memory_budget", &Settings::memory_budget);
  set("max_file_bytes", &Settings::max_file_bytes);
  set("max_primitives", &Settings::max_primitives);
  set("max_memory", &Settings::max_memory);
  set("prefetch_seconds", &Settings::prefetch_seconds);
  set("resume_seconds", &Settings::resume_seconds);
  set("layer_lead_seconds", &Settings::layer_lead_seconds);
  set("retry_seconds", &Settings::retry_seconds);
  set("max_reads_in_flight", &Settings::max_reads_in_flight);
  set("url_max_attempts", &Settings::url_max_attempts);
  set("url_connect_seconds", &Settings::url_connect_seconds);
  set("url_stall_seconds", &Settings::url_stall_seconds);
  set("live_follow", &Settings::live_follow);
  set("live_latency_seconds", &Settings::live_latency_seconds);
  set("live_poll_seconds", &Settings::live_poll_seconds);
  set("live_stall_seconds", &Settings::live_stall_seconds);
  set("live_skip_seconds", &Settings::live_skip_seconds);
  set("url_timeout_seconds", &Settings::url_timeout_seconds);
  set("url_min_bytes_per_second", &Settings::url_min_bytes_per_second);
  set("url_allow_private", &Settings::url_allow_private);
  for (const auto& [name, value] : given) {
    if (known.count(name.cast<std::string>()) != 0) continue;
    throw py::type_error("Player: unknown setting '" + name.cast<std::string>() +
                         "' (see stgs_player_settings)");
  }
  return out;
}

std::string repr_of_status(const stgs_player_status& s) {
  return format("<stgs.PlayerStatus {} at {:.3f} s, {} of {} layers{}>", name_of(kStates, s.state),
                s.seconds, s.layers, s.layer_count, s.is_complete != 0 ? ", complete" : "");
}

std::string repr_of_event(const Event& e) {
  return format("<stgs.PlayerEvent {} at {:.3f} s{}{}>", name_of(kEvents, e.event.kind),
                e.event.seconds, e.message.empty() ? "" : ": ", e.message);
}

std::string repr_of_live(const stgs_player_live& l) {
  if (l.growing == 0) return "<stgs.PlayerLive, not growing>";
  return format("<stgs.PlayerLive {}, {:.3f} s behind the edge at {:.3f} s>",
                l.following != 0 ? "following" : "not following", l.latency_seconds,
                l.edge_seconds);
}

std::string repr_of_statistics(const stgs_player_statistics& s) {
  return format("<stgs.PlayerStatistics {:.0f} bytes/s, {} bytes fetched, {} bytes in memory>",
                s.bytes_per_second, s.fetched_bytes, s.memory_bytes);
}

std::string repr_of_player(Player& player) {
  if (player.is_closed()) return format("<stgs.Player {}, closed>", player.description());
  const stgs_player_status status = player.last_status();
  return format("<stgs.Player {}, {} at {:.3f} s>", player.description(),
                name_of(kStates, status.state), status.seconds);
}

void declare_results(py::module_& module) {
  using Status = stgs_player_status;
  py::class_<Status>(module, "PlayerStatus", "Status of a player; see stgs_player_status.")
      .def_property_readonly(
          "state", [](const Status& s) { return name_of(kStates, s.state); },
          "closed, opening, paused, playing, buffering or ended")
      .def_readonly("seconds", &Status::seconds, "time to render")
      .def_readonly("layers", &Status::layers)
      .def_readonly("layer_count", &Status::layer_count)
      .def_property_readonly("ready", [](const Status& s) { return s.ready != 0; })
      .def_property_readonly("is_complete", [](const Status& s) { return s.is_complete != 0; })
      .def("__repr__", &repr_of_status);
  py::class_<Event>(module, "PlayerEvent", "Event of a player; see stgs_player_event.")
      .def_property_readonly("kind", [](const Event& e) { return name_of(kEvents, e.event.kind); })
      .def_property_readonly("seconds", [](const Event& e) { return e.event.seconds; })
      .def_property_readonly("layers", [](const Event& e) { return e.event.layers; })
      .def_property_readonly("code", [](const Event& e) { return e.event.result; })
      .def_property_readonly("name",
                             [](const Event& e) { return stgs_result_name(e.event.result); })
      .def_property_readonly("offset",
                             [](const Event& e) -> std::optional<std::uint64_t> {
                               if (e.event.offset == STGS_NO_OFFSET) return {};
                               return e.event.offset;
                             })
      .def_readonly("message", &Event::message)
      .def("__repr__", &repr_of_event);
  using Live = stgs_player_live;
  py::class_<Live>(module, "PlayerLive",
                   "Position of playback in a recording; see stgs_player_live.")
      .def_property_readonly("growing", [](const Live& l) { return l.growing != 0; })
      .def_property_readonly("following", [](const Live& l) { return l.following != 0; })
      .def_readonly("edge_seconds", &Live::edge_seconds)
      .def_readonly("latency_seconds", &Live::latency_seconds)
      .def_readonly("target_latency_seconds", &Live::target_latency_seconds)
      .def("__repr__", &repr_of_live);
  using Statistics = stgs_player_statistics;
  py::class_<Statistics>(module, "PlayerStatistics",
                         "Transfer and memory statistics; see stgs_player_statistics.")
      .def_readonly("bytes_per_second", &Statistics::bytes_per_second)
      .def_readonly("fetched_bytes", &Statistics::fetched_bytes)
      .def_readonly("memory_bytes", &Statistics::memory_bytes)
      .def_readonly("stored_primitives", &Statistics::stored_primitives)
      .def("__repr__", &repr_of_statistics);
}

}  // namespace

void declare_player(py::module_& module) {
  declare_results(module);
  const auto calling = [](stgs_result (*function)(stgs_player*)) {
    return [function](Player& player) { player.run(function); };
  };
  py::class_<Player> type(
      module, "Player",
      "Plays a scene while its data is still arriving. Starts to open `source`, as "
      "in Scene. Keyword arguments are the members of stgs_player_settings. Call "
      "update() each frame, then render `scene` at the `seconds` of the status. "
      "A context manager, which closes it.");
  add_closing(type, "Ends the threads of the player and releases its memory.");
  type.def(py::init([](const py::object& source, const py::kwargs& settings) {
             return std::make_unique<Player>(source, settings_of(settings));
           }),
           py::arg("source"))
      .def("wait_open", &Player::wait_open,
           "Blocks until the file is open; Error if opening fails.")
      .def("update", &Player::update, py::arg("now") = py::none(),
           "Advances the player and returns its status. `now` is in seconds of a clock that does "
           "not "
           "run backwards; None: time.monotonic().")
      .def("events", &Player::events, "Returns the events since the last call, oldest first.")
      .def("play", calling(stgs_player_play))
      .def("pause", calling(stgs_player_pause))
      .def(
          "seek",
          [](Player& player, double seconds) {
            player.run([=](stgs_player* p) { return stgs_player_seek(p, seconds); });
          },
          py::arg("seconds"))
      .def("seek_and_wait", &Player::seek_and_wait, py::arg("seconds"), py::arg("timeout") = 30.0,
           "Pauses, moves to a time, blocks until no more data of it is in flight, and returns the "
           "status. Error STGS_ERROR_TIMEOUT after `timeout` seconds.")
      .def(
          "seek_frame",
          [](Player& player, std::uint32_t frame) {
            player.run([=](stgs_player* p) { return stgs_player_seek_frame(p, frame); });
          },
          py::arg("frame"))
      .def_property("rate", &Player::rate, &Player::set_rate,
                    "Playback rate: -2 to 4, not 0; negative rates play backwards.")
      .def_property("loop", &Player::loop, &Player::set_loop)
      .def_property_readonly(
          "scene", &Player::scene, py::return_value_policy::reference_internal,
          "The Scene, for its metadata and for rendering, once the file is open.")
      .def_property_readonly("buffered", &Player::buffered,
                             "Ranges in which playback does not stall: (begin, end) in seconds.")
      .def("go_live", calling(stgs_player_go_live),
           "Moves to the edge of a growing recording and follows it.")
      .def_property_readonly("live", &Player::live)
      .def_property_readonly("statistics", &Player::statistics)
      .def("__repr__", &repr_of_player);
}

}  // namespace stgs::python
