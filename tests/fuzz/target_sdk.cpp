// SPDX-License-Identifier: Apache-2.0
// The C interface, called in whatever order and with whatever arguments the input says: two bytes a
// call. Every result is one that the header names, and what fails says why.
#include <algorithm>
#include <limits>
#include <string>

#include "fuzz_target.h"
#include "stgs/stgs.h"
#include "stgs_file.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

std::vector<Bytes> seeds() {
  return {{0, 0, 2, 1, 1, 0, 3, 0, 5, 6, 6, 14, 4, 0},  // make, open, ask, draw, end
          {6, 0, 0, 4, 2, 1, 1, 1, 5, 22, 0, 2, 1, 65, 3, 1}};
}

// What the scenes may hold, and pictures of 40 x 40.
std::uint64_t most_memory(View) {
  return 96 << 20;
}

struct Calls {
  stgs_scene* scene = nullptr;
  stgs_renderer* renderer = nullptr;
  Bytes file;  // what the scene borrows
  ~Calls() {
    stgs_scene_destroy(scene);
    stgs_renderer_destroy(renderer);
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
    return stgs_scene_create(&settings, &scene);
  }

  stgs_result open(std::uint8_t argument) {
    static const std::vector<Bytes> files = stgs_seeds();
    Bytes bytes = files[argument % files.size()];
    if ((argument & 0x40) != 0) bytes.resize(bytes.size() / 2);
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

  stgs_result draw(std::uint8_t argument, std::uint8_t next) {
    stgs_view view;
    stgs_view_defaults(&view, sizeof view);
    (void)stgs_scene_start_view(scene, &view);
    (void)stgs_view_resize(&view, 1 + argument % 40, 1 + next % 40);
    if ((argument & 0x40) != 0) view.fx = number(next);
    if ((argument & 0x80) != 0) view.translation[next % 3] = number(next);
    Bytes pixels(std::size_t{4} * view.width * view.height);
    stgs_picture picture;
    stgs_picture_defaults(&picture, sizeof picture);
    picture.rgba8 = {pixels.data(), (next & 0x20) != 0 ? next : 0u, pixels.size()};
    return stgs_render(renderer, scene, number(next), &view, &picture, 1);
  }

  stgs_result call(std::uint8_t what, std::uint8_t argument, std::uint8_t next) {
    switch (what % 7) {
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
      default:
        return draw(argument, next);
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
