// SPDX-License-Identifier: Apache-2.0
// The C interface, called in the order and with the arguments of the input, two bytes per call.
// Sources fail, grow and complete late, allocations fail, and threads come from the application.
// Every result is one that the header names, failures have messages, and callbacks are called as
// the header specifies.
#include <algorithm>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>

#include "../fixtures/fragment_fixture.h"
#include "../fixtures/temporary_folder.h"
#include "sdk_calls.h"
#include "stgs_file.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

std::vector<Bytes> seeds() {
  return {{0, 0, 2, 1, 1, 0, 3, 0, 5, 6, 6, 14, 4, 0},  // create, open, query, render, destroy
          {6, 0, 0, 4, 2, 1, 1, 1, 5, 22, 0, 2, 1, 65, 3, 1},
          // A player: create, play, open, wait, update, render, seek, update, destroy.
          {7, 0, 9, 0, 8, 1, 10, 0, 11, 1, 2, 1, 12, 6, 9, 2, 11, 9, 13, 0},
          // A player on a deferred source.
          {7,  1, 8, 0xE2, 21, 0, 14, 0, 21, 0, 14, 0, 21, 0,
           14, 0, 9, 1,    21, 0, 14, 1, 21, 0, 14, 0, 13, 0},
          // A scene and players on sources, with the memory, threads and log of the application.
          {15, 15, 0, 0, 2, 1, 16, 2, 3, 0, 5, 6, 6, 14, 4, 0},
          {15, 13, 7, 0, 9, 0, 8, 0x82, 10, 0, 2, 7, 11, 1, 12, 6, 21, 2, 13, 0},
          {15, 0x2B, 20, 3, 7, 2, 8, 0xC3, 10, 0, 2, 7, 21, 1, 12, 6, 11, 2, 3, 0x81, 13, 0},
          // A recording that grows, changes, shrinks and is closed.
          {7,  0,  9,  0, 8,  0x88, 10, 0, 21, 0, 18, 3, 21, 1, 3,  0x80, 9,  5, 21, 2,
           17, 99, 18, 4, 21, 3,    18, 1, 21, 4, 17, 0, 18, 5, 21, 5,    21, 0, 13, 0},
          {7, 0, 9, 0, 8, 0xC8, 10, 0, 21, 0, 18, 5, 21, 0, 21, 0, 21, 0, 9, 1, 13, 0},
          {7, 4, 8, 0xC8, 10, 0, 21, 0, 18, 0xD0, 2, 1, 12, 6, 21, 1, 13, 0}};
}

// Covers the scenes within their limits, and images of 40 x 40 pixels.
std::uint64_t max_memory(View) {
  return 96 << 20;
}

template <typename Object, typename GetError>
void check_error(const Object* object, GetError&& get_error) {
  stgs_error error{};
  error.struct_size = sizeof error;
  if (object == nullptr || get_error(object, &error) != STGS_OK) return;
  require((error.result == STGS_OK) == (error.message[0] == '\0'), "an error has a message");
}

}  // namespace

namespace stgs::fuzz {

const Recording& recording() {
  static const Recording made = [] {
    constexpr std::uint32_t kFragments = 4;
    const testing::TemporaryFolder folder;
    const std::string path = folder / "live.stgs";
    Recording out;
    auto recorder = SceneRecorder::create(path, testing::recording_metadata(), 1,
                                          testing::recording_settings(Profile::kQuantised));
    require(recorder.ok(), "a recording can be created");
    out.ends.push_back((*recorder)->bytes());
    for (std::uint32_t i = 0; i < kFragments; ++i) {
      const auto frames = (i + 1) * testing::kFragmentFrames;
      require((*recorder)->append(testing::make_fragment(i, 12), frames).ok(),
              "a recording can be continued");
      out.ends.push_back((*recorder)->bytes());
    }
    require((*recorder)->close().ok(), "a recording can be closed");
    std::ifstream file(path, std::ios::binary);
    out.bytes.assign(std::istreambuf_iterator<char>(file), {});
    out.ends.push_back(out.bytes.size());
    return out;
  }();
  return made;
}

Bytes some_file(std::uint8_t argument) {
  static const std::vector<Bytes> files = stgs_seeds();
  Bytes bytes = (argument & 0x08) != 0 ? recording().bytes : files[argument % 8 % files.size()];
  if ((argument & 0x10) != 0) bytes.resize(bytes.size() / 2);
  return bytes;
}

float extreme_number(std::uint8_t argument) {
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

void release_sources(Sources& sources) {
  for (const auto& source : sources) {
    source->complete_reads(true);
    require(source->is_closed(), "an object closes the sources that it owns");
  }
  sources.clear();
}

SdkCalls::~SdkCalls() {
  stgs_scene_destroy(scene);
  stgs_renderer_destroy(renderer);
  stgs_player_destroy(player);
  require(memory.all_freed(), "all memory is returned to the allocator");
  release_sources(scene_sources);
  release_sources(player_sources);
}

void SdkCalls::check(stgs_result result) const {
  require(std::string(stgs_result_name(result)) != "unknown result", "a result has a name");
  check_error(scene, stgs_scene_error);
  check_error(renderer, stgs_renderer_error);
  check_error(player, stgs_player_error);
}

stgs_result SdkCalls::set_hooks(std::uint8_t argument) {
  hooks = argument;
  memory.fail_every(3u * (argument >> 4));
  return STGS_OK;
}

const stgs_task_runner* SdkCalls::runner() const {
  static const stgs_task_runner runners[] = {make_task_runner(RunnerKind::kOneThread),
                                             make_task_runner(RunnerKind::kSequential),
                                             make_task_runner(RunnerKind::kTwoThreads)};
  const unsigned index = hooks / 2 % 4;
  return index == 0 ? nullptr : &runners[index - 1];
}

std::unique_ptr<TestSource> SdkCalls::make_source(std::uint8_t argument) const {
  Bytes bytes = some_file(argument);
  const std::uint64_t size = bytes.size();
  const std::uint64_t sizes[] = {size, size + 100, size / 2, 0, UINT64_MAX};
  const TestSource::Behaviour behaviour{source_behaviour % 16u, (argument & 0x08) != 0,
                                        (argument & 0x20) != 0};
  const std::uint64_t reported =
      behaviour.grows ? recording().ends[1] : sizes[source_behaviour / 16 % 5];
  return std::make_unique<TestSource>(std::move(bytes), reported, behaviour);
}

// The corpus depends on these numbers.
stgs_result SdkCalls::call(std::uint8_t number, std::uint8_t argument, std::uint8_t next) {
  switch (number % 22) {
    case 0:
      return create_scene(argument);
    case 1:
      return open_scene(argument);
    case 2:
      return create_renderer(argument);
    case 3:
      return query_scene((argument & 0x80) != 0 ? stgs_player_scene(player) : scene, argument);
    case 4:
      destroy_scene();
      return STGS_OK;
    case 7:
      return create_player(argument);
    case 8:
      return open_player(argument);
    case 9:
      return control(argument);
    case 10:
      return wait_open();
    case 11:
      return update_player(argument);
    case 12:
      return render(stgs_player_scene(player), argument, next);
    case 13:
      destroy_player();
      return STGS_OK;
    case 14:
      for (const auto& source : player_sources) source->complete_reads(argument % 2 != 0);
      return STGS_OK;
    case 15:
      return set_hooks(argument);
    case 16:
      return open_scene_source(argument);
    case 17:
      replace_source_bytes(argument);
      return STGS_OK;
    case 18:
      resize_sources(argument);
      return STGS_OK;
    case 19:
      extreme_setting = argument;
      return STGS_OK;
    case 20:
      source_behaviour = argument;
      return STGS_OK;
    case 21:
      return wait_player();
    default:
      return render(scene, argument, next);
  }
}

}  // namespace stgs::fuzz

const Target stgs::fuzz::kTarget{"sdk", seeds, nullptr, nullptr, nullptr, max_memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  SdkCalls calls;
  const std::size_t used = std::min<std::size_t>(size, 96);
  for (std::size_t i = 0; i + 1 < used; i += 2) {
    calls.check(calls.call(data[i], data[i + 1], i + 2 < used ? data[i + 2] : 0));
  }
  return 0;
}
