// SPDX-License-Identifier: Apache-2.0
// The C interface, called in whatever order and with whatever arguments the input says: two bytes a
// call. Every result is one that the header names, and what fails says why.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <string>

#include "../api/late_file.h"
#include "fuzz_target.h"
#include "stgs/stgs.h"
#include "stgs_file.h"

using namespace stgs;
using namespace stgs::fuzz;
using stgs::testing::LateFile;

namespace {

std::vector<Bytes> seeds() {
  return {{0, 0, 2, 1, 1, 0, 3, 0, 5, 6, 6, 14, 4, 0},  // make, open, ask, draw, end
          {6, 0, 0, 4, 2, 1, 1, 1, 5, 22, 0, 2, 1, 65, 3, 1},
          // A player: make, play, open, wait, update, draw, seek, update, end.
          {7, 0, 9, 0, 8, 1, 10, 0, 11, 1, 2, 1, 12, 6, 9, 2, 11, 9, 13, 0},
          {7, 1, 8, 3, 11, 0, 14, 1, 11, 1, 14, 0, 9, 1, 13, 0}};
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

struct Calls {
  stgs_scene* scene = nullptr;
  stgs_renderer* renderer = nullptr;
  stgs_player* player = nullptr;
  Bytes file, of_player;  // what the scene and the player borrow
  std::unique_ptr<LateFile> late;
  double now = 0;
  ~Calls() {
    stgs_scene_destroy(scene);
    stgs_renderer_destroy(renderer);
    end_player();
  }

  void end_player() {
    stgs_player_destroy(player);
    player = nullptr;
    late = nullptr;
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

  void check(stgs_result result) const {
    require(std::string(stgs_result_name(result)) != "unknown result", "a result has a name");
    stgs_error error{};
    error.struct_size = sizeof error;
    if (scene == nullptr || stgs_scene_error(scene, &error) != STGS_OK) return;
    require((error.result == STGS_OK) == (error.message[0] == '\0'), "an error has a message");
  }

  stgs_result make(std::uint8_t argument) {
    stgs_scene_settings settings;
    stgs_scene_settings_defaults(&settings, sizeof settings);
    settings.max_memory = (argument & 1) != 0 ? 1 << 20 : 64 << 20;
    settings.max_primitives = (argument & 2) != 0 ? 100 : 1'000'000;
    settings.refuse_damage = argument & 4;
    settings.struct_size -= (argument & 8) != 0 ? 4 : 0;
    stgs_scene_destroy(scene);
    if ((argument & 16) == 0) return stgs_scene_create(&settings, &scene);
    const auto given = of_other_size(settings, argument / 32);
    return stgs_scene_create(reinterpret_cast<const stgs_scene_settings*>(given.data()), &scene);
  }

  static Bytes some_file(std::uint8_t argument) {
    static const std::vector<Bytes> files = stgs_seeds();
    Bytes bytes = files[argument % files.size()];
    if ((argument & 0x40) != 0) bytes.resize(bytes.size() / 2);
    return bytes;
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

  stgs_result ask(std::uint8_t argument) {
    stgs_scene_info info{};
    info.struct_size = sizeof info + argument % 2;
    stgs_issue issue{};
    issue.struct_size = sizeof issue;
    const char* text = nullptr;
    (void)stgs_scene_get_issue(scene, argument, &issue);
    if (stgs_scene_get_text(scene, argument % 4, &text) == STGS_OK) {
      require(text != nullptr, "a text is one");
    }
    (void)list(argument);
    return stgs_scene_get_info(scene, &info);
  }

  // The primitives of a moment, into room for a few.
  stgs_result list(std::uint8_t argument) {
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
    stgs_player_settings settings;
    stgs_player_settings_defaults(&settings, sizeof settings);
    settings.memory_budget = (argument & 1) != 0 ? 1 << 20 : 64 << 20;
    settings.fetches = (argument & 2) != 0 ? 3 : 1;
    settings.retry_seconds = number(argument >> 5);
    end_player();
    return stgs_player_create(&settings, &player);
  }

  // Its bytes, or a source that answers when it is told to.
  stgs_result open_player(std::uint8_t argument) {
    stgs_player_status status{};
    status.struct_size = sizeof status;
    if (stgs_player_update(player, now, &status) != STGS_OK) return STGS_ERROR_ARGUMENT;
    if (status.state != STGS_PLAYER_CLOSED) return stgs_player_open(player, "x");
    late = nullptr;
    of_player = some_file(argument);
    if ((argument & 0x20) != 0) {
      late = std::make_unique<LateFile>(of_player);
      const stgs_async_io io = late->io();
      return stgs_player_open_async_io(player, &io);
    }
    return (argument & 0x80) != 0
               ? stgs_player_open_memory_copy(player, of_player.data(), of_player.size())
               : stgs_player_open_memory(player, of_player.data(), of_player.size());
  }

  stgs_result control(std::uint8_t argument) {
    switch (argument % 6) {
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
      default:
        return stgs_player_set_loop(player, argument >> 7);
    }
  }

  stgs_result update(std::uint8_t argument) {
    now += (argument & 0x80) != 0 ? number(argument) : 0.03;
    stgs_player_status status{};
    status.struct_size = sizeof status + (argument == 255 ? 1 : 0);
    const stgs_result result = stgs_player_update(player, now, &status);
    if (result == STGS_OK) {
      require(status.layers >= 0 && status.layers <= status.layers_of_file, "layers of the file's");
      require(std::isfinite(status.seconds) && status.seconds >= 0, "a moment of the clip's");
    }
    stgs_player_event event{};
    event.struct_size = sizeof event;
    while (stgs_player_next_event(player, &event) == STGS_OK && event.kind != STGS_EVENT_NONE) {
      require((event.result == STGS_OK) == (event.message[0] == '\0'), "an event has its words");
    }
    stgs_time_range ranges[2];
    std::uint32_t count = 0;
    (void)stgs_player_get_buffered(player, ranges, argument % 3, &count);
    return result;
  }

  stgs_result draw(stgs_scene* of, std::uint8_t argument, std::uint8_t next) {
    stgs_view view;
    stgs_view_defaults(&view, sizeof view);
    (void)stgs_scene_start_view(of, &view);
    (void)stgs_view_resize(&view, 1 + argument % 40, 1 + next % 40);
    if ((argument & 0x40) != 0) view.fx = number(next);
    if ((argument & 0x80) != 0) view.translation[next % 3] = number(next);
    Bytes pixels(std::size_t{4} * view.width * view.height);
    stgs_picture picture;
    stgs_picture_defaults(&picture, sizeof picture);
    picture.rgba8 = {pixels.data(), (next & 0x20) != 0 ? next : 0u, pixels.size()};
    if (next < 0xC0) return stgs_render(renderer, of, number(next), &view, &picture, 1);
    const auto views = of_other_size(view, argument), pictures = of_other_size(picture, next);
    return stgs_render(renderer, of, number(next), reinterpret_cast<const stgs_view*>(views.data()),
                       reinterpret_cast<const stgs_picture*>(pictures.data()), 1);
  }

  stgs_result call(std::uint8_t what, std::uint8_t argument, std::uint8_t next) {
    switch (what % 15) {
      case 0:
        return make(argument);
      case 1:
        return open(argument);
      case 2: {
        stgs_renderer_settings settings;
        stgs_renderer_settings_defaults(&settings, sizeof settings);
        settings.backend = argument % 3 == 0 ? 77 : STGS_BACKEND_CPU;
        stgs_renderer_destroy(renderer);
        return stgs_renderer_create(&settings, &renderer);
      }
      case 3:
        return ask(argument);
      case 4:
        stgs_scene_destroy(scene);
        scene = nullptr;
        return STGS_OK;
      case 7:
        return make_player(argument);
      case 8:
        return open_player(argument);
      case 9:
        return control(argument);
      case 10:  // not for what answers late: it would wait for ever
        return late == nullptr ? stgs_player_wait_open(player) : STGS_ERROR_STATE;
      case 11:
        return update(argument);
      case 12:
        return draw(stgs_player_scene(player), argument, next);
      case 13:
        end_player();
        return STGS_OK;
      case 14:
        if (late != nullptr) late->answer(argument % 2);
        return STGS_OK;
      default:
        return draw(scene, argument, next);
    }
  }
};

}  // namespace

const Target stgs::fuzz::kTarget{"sdk", seeds, nullptr, nullptr, nullptr, most_memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Calls calls;
  const std::size_t most = std::min<std::size_t>(size, 64);
  for (std::size_t i = 0; i + 1 < most; i += 2) {
    calls.check(calls.call(data[i], data[i + 1], i + 2 < most ? data[i + 2] : 0));
  }
  return 0;
}
