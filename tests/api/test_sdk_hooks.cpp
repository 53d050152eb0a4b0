// SPDX-License-Identifier: Apache-2.0
// The application's threads and memory in the library's place.
#include <condition_variable>
#include <cstdlib>
#include <deque>

#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

// A job system: threads that take jobs, and a wait that calls the task itself and waits for no job
// that has not begun.
class Jobs {
 public:
  explicit Jobs(int threads) {
    for (int k = 1; k < threads; ++k) threads_.emplace_back([this] { work(); });
    runner.struct_size = sizeof runner;
    runner.user = this;
    runner.threads = static_cast<std::uint32_t>(threads);
    runner.run = [](void* user, void (*task)(void*), void* argument, std::uint32_t count) {
      static_cast<Jobs*>(user)->run(task, argument, count);
    };
  }
  ~Jobs() {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
    }
    changed_.notify_all();
    for (std::thread& thread : threads_) thread.join();
  }

  stgs_task_runner runner{};
  std::atomic<int> runs{0}, by_others{0};
  std::atomic<bool> halted{false};

 private:
  struct Batch {
    void (*task)(void*);
    void* argument;
    std::uint32_t left, running;
  };

  void run(void (*task)(void*), void* argument, std::uint32_t count) {
    ++runs;
    halted.wait(true);
    Batch batch{task, argument, count - 1, 0};
    std::unique_lock lock(mutex_);
    if (batch.left > 0) batches_.push_back(&batch);
    changed_.notify_all();
    lock.unlock();
    task(argument);
    lock.lock();
    std::erase(batches_, &batch);
    changed_.wait(lock, [&] { return batch.running == 0; });
  }
  void work() {
    std::unique_lock lock(mutex_);
    for (;;) {
      changed_.wait(lock, [&] { return ending_ || !batches_.empty(); });
      if (ending_) return;
      Batch* const batch = batches_.front();
      ++batch->running;
      if (--batch->left == 0) batches_.pop_front();
      lock.unlock();
      batch->task(batch->argument);
      ++by_others;
      lock.lock();
      if (--batch->running == 0) changed_.notify_all();
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Batch*> batches_;
  bool ending_ = false;
  std::vector<std::thread> threads_;
};

// Counts what is taken, and has nothing left for one of the requests.
class Memory {
 public:
  Memory() {
    allocator.struct_size = sizeof allocator;
    allocator.user = this;
    allocator.allocate = [](void* user, std::size_t bytes, std::size_t alignment) {
      return static_cast<Memory*>(user)->take(bytes, alignment);
    };
    allocator.free = [](void* user, void* memory, std::size_t bytes, std::size_t) {
      static_cast<Memory*>(user)->held -= static_cast<std::int64_t>(bytes);
      std::free(memory);
    };
  }

  stgs_allocator allocator{};
  std::atomic<std::int64_t> held{0};
  std::atomic<int> requests{0}, fails_at{-1};

 private:
  void* take(std::size_t wanted, std::size_t alignment) {
    if (requests++ == fails_at) return nullptr;
    held += static_cast<std::int64_t>(wanted);
    return std::aligned_alloc(alignment, (wanted + alignment - 1) / alignment * alignment);
  }
};

constexpr std::uint64_t kHeldBytes = (17 + 3 * 4 + 2) * sizeof(float);  // a primitive of degree 1

RendererPtr renderer_by(const stgs_task_runner* runner) {
  stgs_renderer_settings settings;
  REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.backend = STGS_BACKEND_CPU;
  settings.task_runner = runner;
  stgs_renderer* renderer = nullptr;
  REQUIRE(stgs_renderer_create(&settings, &renderer) == STGS_OK);
  return RendererPtr(renderer);
}

}  // namespace

TEST_CASE("the application's threads draw what the library's draw", "[sdk]") {
  const ScenePtr scene = open_scene(clip_file());
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  const auto expected = draw_rgba8(cpu_renderer().get(), scene.get(), 1.0, view);
  for (const int threads : {1, 3}) {
    Jobs jobs(threads);
    const ScenePtr own = open_scene(clip_file());
    const RendererPtr renderer = renderer_by(&jobs.runner);
    CHECK(draw_rgba8(renderer.get(), own.get(), 1.0, view) == expected);
    CHECK(jobs.runs >= 4);  // decoding, and the stages of drawing
    CHECK((jobs.by_others > 0) == (threads > 1));
  }
}

TEST_CASE("a player decodes by the application's threads, and by no others", "[sdk]") {
  Jobs jobs(8);
  stgs_player_settings settings = player_settings();
  settings.task_runner = &jobs.runner;
  jobs.halted = true;
  PlayerPtr player = make_player(&settings);
  settings.task_runner = nullptr;  // it was copied
  REQUIRE(stgs_player_open_memory(player.get(), clip_file().data(), clip_file().size()) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  stgs_player_statistics statistics{};
  statistics.struct_size = sizeof statistics;
  REQUIRE(update_until(player.get(), 0, [&](const stgs_player_status&) {
    REQUIRE(stgs_player_get_statistics(player.get(), &statistics) == STGS_OK);
    return jobs.runs == 4 && statistics.fetched_bytes > clip_file().size() / 2;
  }));
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  CHECK(jobs.runs == 4);  // several segments, and no more: half of its threads
  CHECK(statistics.stored_primitives == 0);
  CHECK(update(player.get(), 0).ready == 0);
  jobs.halted = false;
  jobs.halted.notify_all();
  REQUIRE(settle(player.get(), 0));
  CHECK(update(player.get(), 0).ready == 1);
  CHECK(jobs.runs > 10);
}

TEST_CASE("what a scene holds is in the application's memory", "[sdk]") {
  Memory memory;
  stgs_scene_settings settings = scene_settings();
  settings.allocator = &memory.allocator;
  ScenePtr scene = make_scene(&settings);
  REQUIRE(stgs_scene_open_memory_copy(scene.get(), clip_file().data(), clip_file().size()) ==
          STGS_OK);
  CHECK(memory.held == static_cast<std::int64_t>(clip_file().size()));
  const RendererPtr renderer = cpu_renderer();
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  (void)draw_rgba8(renderer.get(), scene.get(), 1.0, view);
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  REQUIRE(stgs_scene_get_info(scene.get(), &info) == STGS_OK);
  // But for lists of what is seen at the moment, an index a primitive.
  const std::uint64_t primitives = info.memory_bytes / (kHeldBytes + sizeof(std::uint32_t));
  CHECK(primitives > 500);
  CHECK(static_cast<std::uint64_t>(memory.held) - clip_file().size() == primitives * kHeldBytes);
  scene.reset();
  CHECK(memory.held == 0);
}

TEST_CASE("what a player holds is in the application's memory", "[sdk]") {
  Memory memory;
  stgs_player_settings settings = player_settings();
  settings.allocator = &memory.allocator;
  const RendererPtr renderer = cpu_renderer();
  PlayerPtr player = open_player(clip_file(), &settings);
  REQUIRE(settle(player.get(), 0));
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  (void)draw_rgba8(renderer.get(), stgs_player_scene(player.get()), 0, view);
  stgs_player_statistics statistics{};
  statistics.struct_size = sizeof statistics;
  REQUIRE(stgs_player_get_statistics(player.get(), &statistics) == STGS_OK);
  CHECK(statistics.stored_primitives > 500);
  CHECK(static_cast<std::uint64_t>(memory.held) >= statistics.stored_primitives * kHeldBytes);
  player.reset();
  CHECK(memory.held == 0);
}

TEST_CASE("whichever request finds no memory, a scene says so and can be drawn after", "[sdk]") {
  const RendererPtr renderer = cpu_renderer();
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  REQUIRE(stgs_view_resize(&view, kSdkWidth, kSdkHeight) == STGS_OK);
  const auto expected = draw_rgba8(renderer.get(), open_scene(clip_file()).get(), 1.0, view);
  int failed = 0;
  for (int n = 0;; ++n) {
    Memory memory;
    memory.fails_at = n;
    stgs_scene_settings settings = scene_settings();
    settings.allocator = &memory.allocator;
    ScenePtr scene = make_scene(&settings);
    std::vector<std::uint8_t> pixels(expected.size());
    stgs_image picture = empty_picture();
    picture.rgba8 = {pixels.data(), 0, pixels.size()};
    const auto& file = clip_file();
    stgs_result result = stgs_scene_open_memory_copy(scene.get(), file.data(), file.size());
    if (result == STGS_OK) {
      result = stgs_render(renderer.get(), scene.get(), 1.0, &view, &picture, 1);
      if (result != STGS_OK) {
        CHECK(error_of(renderer.get()).result == STGS_ERROR_OUT_OF_MEMORY);
        CHECK(draw_rgba8(renderer.get(), scene.get(), 1.0, view) == expected);
      }
    }
    scene.reset();
    REQUIRE(memory.held == 0);
    if (memory.requests <= n) {
      CHECK(result == STGS_OK);
      break;
    }
    REQUIRE(result == STGS_ERROR_OUT_OF_MEMORY);
    ++failed;
  }
  CHECK(failed > 50);
}

TEST_CASE("whichever request finds no memory, a player says so and makes up for it", "[sdk]") {
  int opened = 0, lost = 0;
  for (int n = 0;; ++n) {
    Memory memory;
    memory.fails_at = n;
    stgs_player_settings settings = player_settings();
    settings.allocator = &memory.allocator;
    settings.retry_seconds = 0.001;
    PlayerPtr player = make_player(&settings);
    const auto& file = clip_file();
    const stgs_result result = stgs_player_open_memory_copy(player.get(), file.data(), file.size());
    if (result == STGS_OK) {
      REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
      ++opened;
      REQUIRE(update_until(player.get(), 0, [](const stgs_player_status& status) {
        return status.layers == status.layer_count;
      }));
      for (const KeptEvent& one : take_events(player.get())) {
        if (one.event.kind != STGS_EVENT_READ_FAILED) continue;
        CHECK(one.event.result == STGS_ERROR_OUT_OF_MEMORY);
        ++lost;
      }
    } else {
      CHECK(result == STGS_ERROR_OUT_OF_MEMORY);
    }
    player.reset();
    REQUIRE(memory.held == 0);
    if (memory.requests <= n) break;
  }
  CHECK(opened > 100);
  CHECK(lost > 50);
}

TEST_CASE("a task runner that cannot run is refused", "[sdk]") {
  Jobs jobs(1);
  stgs_renderer_settings settings;
  REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
  stgs_player_settings of_player = player_settings();
  settings.task_runner = of_player.task_runner = &jobs.runner;
  stgs_renderer* renderer = nullptr;
  stgs_player* player = nullptr;
  jobs.runner.threads = 0;
  CHECK(stgs_renderer_create(&settings, &renderer) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_player_create(&of_player, &player) == STGS_ERROR_ARGUMENT);
  jobs.runner.threads = 1;
  jobs.runner.struct_size = 3;
  CHECK(stgs_renderer_create(&settings, &renderer) == STGS_ERROR_STRUCT_SIZE);
  jobs.runner.struct_size = sizeof jobs.runner;
  jobs.runner.run = nullptr;
  CHECK(stgs_player_create(&of_player, &player) == STGS_ERROR_ARGUMENT);
  CHECK(renderer == nullptr);
  CHECK(player == nullptr);
}

}  // namespace stgs::testing
