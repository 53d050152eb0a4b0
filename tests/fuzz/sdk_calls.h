// SPDX-License-Identifier: Apache-2.0
// The state and the calls of the target sdk. sdk_scene_calls.cpp and sdk_player_calls.cpp implement
// the calls; target_sdk.cpp maps the input to them.
#pragma once

#include <memory>

#include "choices.h"
#include "fuzz_target.h"
#include "sdk_hooks.h"
#include "sdk_source.h"
#include "stgs/stgs.h"

namespace stgs::fuzz {

struct Recording {
  Bytes bytes;
  // [i]: the size when i fragments were complete; the last: the size of the closed file.
  std::vector<std::uint64_t> ends;
};
// A recording of four fragments.
const Recording& recording();
// A seed file or the recording, complete or truncated.
Bytes some_file(std::uint8_t argument);
// A number that interfaces mishandle.
float extreme_number(std::uint8_t argument);

using Sources = std::vector<std::unique_ptr<TestSource>>;

struct SdkCalls {
  stgs_scene* scene = nullptr;
  stgs_renderer* renderer = nullptr;
  stgs_player* player = nullptr;
  Bytes scene_bytes, player_bytes;  // borrowed by the scene and the player
  // The last source of each is open; the ones before it could not be opened.
  Sources scene_sources, player_sources;
  TestAllocator memory;
  const stgs_allocator callbacks = memory.callbacks();
  std::uint8_t hooks = 0;             // set by set_hooks()
  std::uint8_t extreme_setting = 0;   // a setting of the next player with an extreme number
  std::uint8_t source_behaviour = 0;  // behaviour and size of the next sources
  double now = 0;                     // seconds
  int events = 0;                     // from the last update_player()

  SdkCalls() = default;
  SdkCalls(const SdkCalls&) = delete;
  SdkCalls& operator=(const SdkCalls&) = delete;
  ~SdkCalls();

  stgs_result call(std::uint8_t number, std::uint8_t argument, std::uint8_t next);
  // Checks the name of the result and the errors of all objects.
  void check(stgs_result result) const;

  // Selects the allocator, task runner and log of objects created from now on.
  stgs_result set_hooks(std::uint8_t argument);
  const stgs_allocator* allocator() const { return (hooks & 1) != 0 ? &callbacks : nullptr; }
  const stgs_task_runner* runner() const;
  stgs_log_fn log() const { return (hooks & 8) != 0 ? check_log_line : nullptr; }
  // A source whose size and behaviour follow source_behaviour; recordings grow.
  std::unique_ptr<TestSource> make_source(std::uint8_t argument) const;

  stgs_result create_scene(std::uint8_t argument);
  stgs_result open_scene(std::uint8_t argument);
  stgs_result open_scene_source(std::uint8_t argument);
  void destroy_scene();
  stgs_result create_renderer(std::uint8_t argument);
  stgs_result render(stgs_scene* rendered, std::uint8_t argument, std::uint8_t next);

  stgs_result create_player(std::uint8_t argument);
  stgs_result open_player(std::uint8_t argument);
  stgs_result open_player_source(std::uint8_t argument);
  stgs_result wait_open() const;
  stgs_result control(std::uint8_t argument);
  stgs_result update_player(std::uint8_t argument);
  stgs_result wait_player();
  void query_player(std::uint8_t argument) const;
  void replace_source_bytes(std::uint8_t argument);
  void resize_sources(std::uint8_t argument);
  void destroy_player();
};

// Queries a scene: its information, issues, texts and primitives.
stgs_result query_scene(stgs_scene* scene, std::uint8_t argument);
// Completes the pending reads of the sources of a destroyed object and checks that it closed them.
void release_sources(Sources& sources);

}  // namespace stgs::fuzz
