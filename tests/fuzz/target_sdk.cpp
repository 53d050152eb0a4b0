// SPDX-License-Identifier: Apache-2.0
// The C interface, called in whatever order and with whatever arguments the input says: two bytes a
// call. Sources fail, grow and answer late, memory ends, and threads are the caller's. Every result
// is one that the header names, what fails says why, and what was lent is called as the header
// says.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <memory>
#include <string>
#include <thread>

#include "../api/stretch_fixture.h"
#include "../api/temporary_folder.h"
#include "fuzz_target.h"
#include "sdk_hooks.h"
#include "sdk_source.h"
#include "stgs/stgs.h"
#include "stgs_file.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

std::vector<Bytes> seeds() {
  return {{0, 0, 2, 1, 1, 0, 3, 0, 5, 6, 6, 14, 4, 0},  // make, open, ask, draw, end
          {6, 0, 0, 4, 2, 1, 1, 1, 5, 22, 0, 2, 1, 65, 3, 1},
          // A player: make, play, open, wait, update, draw, seek, update, end.
          {7, 0, 9, 0, 8, 1, 10, 0, 11, 1, 2, 1, 12, 6, 9, 2, 11, 9, 13, 0},
          // One over a source that answers late.
          {7,  1, 8, 0xE2, 21, 0, 14, 0, 21, 0, 14, 0, 21, 0,
           14, 0, 9, 1,    21, 0, 14, 1, 21, 0, 14, 0, 13, 0},
          // A scene and a player over sources, with memory, threads and a log of the caller's.
          {15, 15, 0, 0, 2, 1, 16, 2, 3, 0, 5, 6, 6, 14, 4, 0},
          {15, 13, 7, 0, 9, 0, 8, 0x82, 10, 0, 2, 7, 11, 1, 12, 6, 21, 2, 13, 0},
          {15, 0x2B, 20, 3, 7, 2, 8, 0xC3, 10, 0, 2, 7, 21, 1, 12, 6, 11, 2, 3, 0x81, 13, 0},
          // A recording that grows, is changed, becomes shorter, and is closed.
          {7,  0,  9,  0, 8,  0x88, 10, 0, 21, 0, 18, 3, 21, 1, 3,  0x80, 9,  5, 21, 2,
           17, 99, 18, 4, 21, 3,    18, 1, 21, 4, 17, 0, 18, 5, 21, 5,    21, 0, 13, 0},
          {7, 0, 9, 0, 8, 0xC8, 10, 0, 21, 0, 18, 5, 21, 0, 21, 0, 21, 0, 9, 1, 13, 0},
          {7, 4, 8, 0xC8, 10, 0, 21, 0, 18, 0xD0, 2, 1, 12, 6, 21, 1, 13, 0}};
}

struct Recording {
  Bytes bytes;
  std::vector<std::uint64_t> ends;  // [i]: when i stretches were complete; the last: closed
};

const Recording& recording() {
  static const Recording made = [] {
    constexpr std::uint32_t kStretches = 4;
    const testing::TemporaryFolder folder;
    const std::string path = folder / "live.stgs";
    Recording out;
    auto recorder = SceneRecorder::create(path, testing::recording_metadata(), 1,
                                          testing::recording_settings(Profile::kQuantised));
    require(recorder.ok(), "a recording is begun");
    out.ends.push_back((*recorder)->bytes());
    for (std::uint32_t i = 0; i < kStretches; ++i) {
      const auto frames = (i + 1) * testing::kStretchFrames;
      require((*recorder)->append(testing::stretch(i, 12), frames).ok(), "a recording goes on");
      out.ends.push_back((*recorder)->bytes());
    }
    require((*recorder)->close().ok(), "a recording ends");
    std::ifstream file(path, std::ios::binary);
    out.bytes.assign(std::istreambuf_iterator<char>(file), {});
    out.ends.push_back(out.bytes.size());
    return out;
  }();
  return made;
}

// What the scenes may hold, and pictures of 40 x 40.
std::uint64_t most_memory(View) {
  return 96 << 20;
}

// A struct as a program with a shorter or longer one has it, in memory that ends with it.
template <typename T>
std::vector<std::uint64_t> of_other_size(const T& value, std::uint8_t argument) {
  std::vector<std::uint64_t> words(2 + argument % (sizeof(T) / 8 + 4));
  const std::size_t bytes = 8 * words.size();
  std::memcpy(words.data(), &value, std::min(bytes, sizeof value));
  words[0] = bytes;
  return words;
}

using Files = std::vector<std::unique_ptr<LentFile>>;

struct Calls {
  stgs_scene* scene = nullptr;
  stgs_renderer* renderer = nullptr;
  stgs_player* player = nullptr;
  Bytes file, of_player;            // what the scene and the player borrow
  Files scene_files, player_files;  // theirs: the last is open, those before could not be opened
  LentMemory memory;
  const stgs_allocator hook = memory.hook();
  std::uint8_t lent = 0, odd = 0, habits = 0;  // what lend(), and calls 19 and 20, said last
  double now = 0;
  int events = 0;  // that the last update() brought

  ~Calls() {
    stgs_scene_destroy(scene);
    stgs_renderer_destroy(renderer);
    stgs_player_destroy(player);
    require(memory.all_is_back(), "memory that was lent comes back");
    end_files(scene_files);
    end_files(player_files);
  }

  // Of an object that has ended.
  static void end_files(Files& files) {
    for (const auto& file : files) {
      file->answer(true);
      require(file->is_closed(), "a source that was taken is closed");
    }
    files.clear();
  }
  void end_scene() {
    stgs_scene_destroy(scene);
    scene = nullptr;
    end_files(scene_files);
  }
  void end_player() {
    stgs_player_destroy(player);
    player = nullptr;
    end_files(player_files);
  }

  // One of the numbers that programs get wrong.
  static float number(std::uint8_t argument) {
    constexpr float kNumbers[] = {0,
                                  -1,
                                  1e-30f,
                                  1e30f,
                                  std::numeric_limits<float>::quiet_NaN(),
                                  std::numeric_limits<float>::infinity(),
                                  0.5f,
                                  40};
    return kNumbers[argument % 8];
  }

  template <typename Object, typename Tell>
  static void check_error(const Object* object, Tell&& tell) {
    stgs_error error{};
    error.struct_size = sizeof error;
    if (object == nullptr || tell(object, &error) != STGS_OK) return;
    require((error.result == STGS_OK) == (error.message[0] == '\0'), "an error has a message");
  }
  void check(stgs_result result) const {
    require(std::string(stgs_result_name(result)) != "unknown result", "a result has a name");
    check_error(scene, stgs_scene_error);
    check_error(renderer, stgs_renderer_error);
    check_error(player, stgs_player_error);
  }

  // What objects made from now on get of the caller's.
  stgs_result lend(std::uint8_t argument) {
    lent = argument;
    memory.fail_each(3u * (argument >> 4));
    return STGS_OK;
  }
  const stgs_allocator* allocator() const { return (lent & 1) != 0 ? &hook : nullptr; }
  const stgs_task_runner* runner() const {
    static const stgs_task_runner runners[] = {lent_threads(Runner::kOnce),
                                               lent_threads(Runner::kAllInTurn),
                                               lent_threads(Runner::kTwoThreads)};
    const unsigned which = lent / 2 % 4;
    return which == 0 ? nullptr : &runners[which - 1];
  }
  stgs_log_fn log() const { return (lent & 8) != 0 ? check_log_line : nullptr; }

  stgs_result make(std::uint8_t argument) {
    stgs_scene_settings settings;
    stgs_scene_settings_defaults(&settings, sizeof settings);
    settings.max_memory = (argument & 1) != 0 ? 1 << 20 : 64 << 20;
    settings.max_primitives = (argument & 2) != 0 ? 100 : 1'000'000;
    settings.reject_damage = argument & 4;
    settings.struct_size -= (argument & 8) != 0 ? 4 : 0;
    settings.allocator = allocator();
    settings.log = log();
    end_scene();
    if ((argument & 16) == 0) return stgs_scene_create(&settings, &scene);
    const auto given = of_other_size(settings, argument / 32);
    return stgs_scene_create(reinterpret_cast<const stgs_scene_settings*>(given.data()), &scene);
  }

  static Bytes some_file(std::uint8_t argument) {
    static const std::vector<Bytes> files = stgs_seeds();
    Bytes bytes = (argument & 0x08) != 0 ? recording().bytes : files[argument % 8 % files.size()];
    if ((argument & 0x10) != 0) bytes.resize(bytes.size() / 2);
    return bytes;
  }

  // One that is as large as call 20 had it, and grows where it is a recording.
  std::unique_ptr<LentFile> some_source(std::uint8_t argument) const {
    Bytes bytes = some_file(argument);
    const std::uint64_t size = bytes.size();
    const std::uint64_t sizes[] = {size, size + 100, size / 2, 0, UINT64_MAX};
    const LentFile::Habits behaves{habits % 16u, (argument & 0x08) != 0, (argument & 0x20) != 0};
    const std::uint64_t told = behaves.grows ? recording().ends[1] : sizes[habits / 16 % 5];
    return std::make_unique<LentFile>(std::move(bytes), told, behaves);
  }

  stgs_result open(std::uint8_t argument) {
    Bytes bytes = some_file(argument);
    if ((argument & 0x80) != 0)
      return stgs_scene_open_memory_copy(scene, bytes.data(), bytes.size());
    stgs_scene_info info{};
    info.struct_size = sizeof info;
    // Not while it is borrowed.
    if (stgs_scene_get_info(scene, &info) != STGS_OK) file = std::move(bytes);
    return stgs_scene_open_memory(scene, file.data(), file.size());
  }

  // Whether a source that an object was given is its own from now on.
  static bool is_taken(stgs_result result) {
    return result != STGS_ERROR_ARGUMENT && result != STGS_ERROR_STRUCT_SIZE &&
           result != STGS_ERROR_STATE;
  }

  stgs_result open_source(std::uint8_t argument) {
    auto source = some_source(argument);
    stgs_io io = source->io();
    if ((argument & 0x80) != 0) io.struct_size -= 8;
    const stgs_result result = stgs_scene_open_io(scene, &io);
    require(
        source->is_closed() == (is_taken(result) && result != STGS_OK),
        "a source is closed when it could not be opened, and left alone where it was not tried");
    if (result == STGS_OK) scene_files.push_back(std::move(source));
    return result;
  }

  static stgs_result ask(stgs_scene* scene, std::uint8_t argument) {
    stgs_scene_info info{};
    info.struct_size = sizeof info + argument % 2;
    stgs_issue issue{};
    issue.struct_size = sizeof issue;
    const char* text = nullptr;
    (void)stgs_scene_get_issue(scene, argument, &issue);
    if (stgs_scene_get_text(scene, argument % 4, &text) == STGS_OK) {
      require(text != nullptr, "a text is one");
    }
    (void)list(scene, argument);
    return stgs_scene_get_info(scene, &info);
  }

  // The primitives of a moment, into room for a few.
  static stgs_result list(stgs_scene* scene, std::uint8_t argument) {
    const std::size_t room = argument % 16;
    std::vector<float> opacity(room);
    std::vector<float> position(3 * room);
    stgs_primitives primitives;
    stgs_primitives_defaults(&primitives, sizeof primitives);
    primitives.capacity = room;
    primitives.opacity = opacity.data();
    primitives.position = position.data();
    std::uint64_t count = 0;
    const stgs_result result =
        stgs_scene_get_primitives(scene, number(argument / 16), &primitives, &count);
    for (std::size_t i = 0; result == STGS_OK && i < std::min<std::size_t>(count, room); ++i) {
      require(opacity[i] > 0 && opacity[i] <= 1, "what is listed is seen");
    }
    return result;
  }

  stgs_result make_player(std::uint8_t argument) {
    using Settings = stgs_player_settings;
    constexpr double Settings::*kSeconds[] = {
        &Settings::prefetch_seconds,   &Settings::resume_seconds,
        &Settings::layer_lead_seconds, &Settings::retry_seconds,
        &Settings::live_poll_seconds,  &Settings::live_latency_seconds,
        &Settings::live_stall_seconds, &Settings::live_skip_seconds,
        &Settings::url_stall_seconds,  &Settings::url_connect_seconds};
    Settings settings;
    stgs_player_settings_defaults(&settings, sizeof settings);
    settings.memory_budget = settings.max_memory = (argument & 1) != 0 ? 1 << 20 : 64 << 20;
    settings.max_reads_in_flight = (argument & 2) != 0 ? 3 : 1;
    settings.live_follow = (argument & 4) != 0 ? 0 : 1;
    settings.live_poll_seconds = settings.live_stall_seconds = 0;
    settings.allocator = allocator();
    settings.task_runner = runner();
    settings.log = log();
    if (odd != 0) settings.*kSeconds[odd / 8 % std::size(kSeconds)] = number(odd);
    end_player();
    if ((argument & 8) == 0) return stgs_player_create(&settings, &player);
    const auto given = of_other_size(settings, argument / 16);
    return stgs_player_create(reinterpret_cast<const Settings*>(given.data()), &player);
  }

  // Bytes, or a source.
  stgs_result open_player(std::uint8_t argument) {
    stgs_player_status status{};
    status.struct_size = sizeof status;
    if (stgs_player_update(player, now, &status) != STGS_OK) return STGS_ERROR_ARGUMENT;
    if (status.state != STGS_PLAYER_CLOSED) return stgs_player_open(player, "x");
    if (argument >= 0x80) return open_player_source(argument);
    of_player = some_file(argument);
    return (argument & 0x40) != 0
               ? stgs_player_open_memory_copy(player, of_player.data(), of_player.size())
               : stgs_player_open_memory(player, of_player.data(), of_player.size());
  }
  stgs_result open_player_source(std::uint8_t argument) {
    auto source = some_source(argument);
    stgs_result result = STGS_OK;
    if ((argument & 0x40) != 0) {
      const stgs_async_io io = source->async_io();
      result = stgs_player_open_async_io(player, &io);
    } else {
      const stgs_io io = source->io();
      result = stgs_player_open_io(player, &io);
    }
    if (result == STGS_OK) player_files.push_back(std::move(source));
    return result;
  }
  // Not for what answers late: it would wait for ever.
  stgs_result wait_open() const {
    const bool late = !player_files.empty() && player_files.back()->is_late();
    return late ? STGS_ERROR_STATE : stgs_player_wait_open(player);
  }

  // The player's source becomes another, or a byte of it.
  void change(std::uint8_t argument) {
    Bytes bytes = recording().bytes;
    if ((argument & 0x80) != 0) {
      bytes = some_file(argument);
    } else {
      bytes[bytes.size() * argument / 128] ^= 1;
    }
    for (const auto& source : player_files) source->become(bytes);
  }
  // To the end of a stretch, or somewhere.
  void grow(std::uint8_t argument) {
    const auto& ends = recording().ends;
    const std::uint64_t size =
        argument < 0x80 ? ends[argument % ends.size()] : ends.back() * (argument - 0x80u) / 0x70;
    for (const auto& source : player_files) source->resize(size);
  }

  stgs_result control(std::uint8_t argument) {
    switch (argument % 7) {
      case 0:
        return stgs_player_play(player);
      case 1:
        return stgs_player_pause(player);
      case 2:
        return stgs_player_seek(player, number(argument >> 5));
      case 3:
        return stgs_player_seek_frame(player, argument >> 4);
      case 4:
        return stgs_player_set_rate(player, number(argument >> 5));
      case 5:
        return stgs_player_go_live(player);
      default:
        return stgs_player_set_loop(player, argument >> 7);
    }
  }

  stgs_result update(std::uint8_t argument) {
    now += 0.03;
    const double told = (argument & 0x80) != 0 ? now + number(argument) : now;
    stgs_player_status status{};
    status.struct_size = sizeof status + (argument == 255 ? 1 : 0);
    const stgs_result result = stgs_player_update(player, told, &status);
    if (result == STGS_OK) {
      require(status.layers >= 0 && status.layers <= status.layer_count, "layers of the file's");
      require(std::isfinite(status.seconds) && status.seconds >= 0, "a moment of the clip's");
    }
    stgs_player_event event{};
    event.struct_size = sizeof event;
    events = 0;
    while (stgs_player_next_event(player, &event) == STGS_OK && event.kind != STGS_EVENT_NONE) {
      require((event.result == STGS_OK) == (event.message[0] == '\0'), "an event has its words");
      ++events;
    }
    look(argument);
    return result;
  }
  // Time for a player's threads: until something has happened, or for 20 ms.
  stgs_result wait() {
    stgs_result result = STGS_OK;
    for (int k = 0; k < 20 && !player_files.empty() && !player_files.back()->is_waited_for(); ++k) {
      result = update(0);
      if (events > 0) break;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return result;
  }
  // What else there is to be known of a player.
  void look(std::uint8_t argument) const {
    stgs_player_live live{};
    live.struct_size = sizeof live;
    if (stgs_player_get_live(player, &live) == STGS_OK) {
      require(live.growing != 0 || live.edge_seconds == 0, "what does not grow has no edge");
      require(std::isfinite(live.edge_seconds) && std::isfinite(live.latency_seconds),
              "an edge is somewhere");
    }
    stgs_player_statistics statistics{};
    statistics.struct_size = sizeof statistics;
    (void)stgs_player_get_statistics(player, &statistics);
    stgs_time_range ranges[2];
    std::uint32_t count = 0;
    (void)stgs_player_get_buffered(player, ranges, argument % 3, &count);
  }

  stgs_result draw(stgs_scene* of, std::uint8_t argument, std::uint8_t next) {
    stgs_view view;
    stgs_view_defaults(&view, sizeof view);
    (void)stgs_scene_start_view(of, &view);
    (void)stgs_view_resize(&view, 1 + argument % 40, 1 + next % 40);
    if ((argument & 0x40) != 0) view.fx = number(next);
    if ((argument & 0x80) != 0) view.translation[next % 3] = number(next);
    if ((next & 0x10) != 0 && stgs_scene_frame_view(of, &view) == STGS_OK) {
      require(std::isfinite(view.translation[next % 3]) && view.near_plane > 0, "a view is one");
    }
    Bytes pixels(std::size_t{4} * view.width * view.height);
    stgs_image picture;
    stgs_image_defaults(&picture, sizeof picture);
    picture.rgba8 = {pixels.data(), (next & 0x20) != 0 ? next : 0u, pixels.size()};
    if (next < 0xC0) return stgs_render(renderer, of, number(next), &view, &picture, 1);
    const auto views = of_other_size(view, argument), pictures = of_other_size(picture, next);
    return stgs_render(renderer, of, number(next), reinterpret_cast<const stgs_view*>(views.data()),
                       reinterpret_cast<const stgs_image*>(pictures.data()), 1);
  }

  stgs_result make_renderer(std::uint8_t argument) {
    stgs_renderer_settings settings;
    stgs_renderer_settings_defaults(&settings, sizeof settings);
    settings.backend = argument % 3 == 0 ? 77 : STGS_BACKEND_CPU;
    settings.task_runner = runner();
    settings.log = log();
    stgs_renderer_destroy(renderer);
    return stgs_renderer_create(&settings, &renderer);
  }

  stgs_result call(std::uint8_t what, std::uint8_t argument, std::uint8_t next) {
    switch (what % 22) {
      case 0:
        return make(argument);
      case 1:
        return open(argument);
      case 2:
        return make_renderer(argument);
      case 3:
        return ask((argument & 0x80) != 0 ? stgs_player_scene(player) : scene, argument);
      case 4:
        end_scene();
        return STGS_OK;
      case 7:
        return make_player(argument);
      case 8:
        return open_player(argument);
      case 9:
        return control(argument);
      case 10:
        return wait_open();
      case 11:
        return update(argument);
      case 12:
        return draw(stgs_player_scene(player), argument, next);
      case 13:
        end_player();
        return STGS_OK;
      case 14:
        for (const auto& source : player_files) source->answer(argument % 2 != 0);
        return STGS_OK;
      case 15:
        return lend(argument);
      case 16:
        return open_source(argument);
      case 17:
        change(argument);
        return STGS_OK;
      case 18:
        grow(argument);
        return STGS_OK;
      case 19:
        odd = argument;
        return STGS_OK;
      case 20:
        habits = argument;
        return STGS_OK;
      case 21:
        return wait();
      default:
        return draw(scene, argument, next);
    }
  }
};

}  // namespace

const Target stgs::fuzz::kTarget{"sdk", seeds, nullptr, nullptr, nullptr, most_memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Calls calls;
  const std::size_t most = std::min<std::size_t>(size, 96);
  for (std::size_t i = 0; i + 1 < most; i += 2) {
    calls.check(calls.call(data[i], data[i + 1], i + 2 < most ? data[i + 2] : 0));
  }
  return 0;
}
