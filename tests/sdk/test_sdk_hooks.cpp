// SPDX-License-Identifier: Apache-2.0
// Hooks of the C API: the application provides the threads and the memory.
#include <condition_variable>
#include <cstdlib>
#include <deque>

#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

// A job system of an application. run() calls the task on its own thread too, and waits only for
// jobs that have started.
class JobSystem {
 public:
  explicit JobSystem(int threads) {
    for (int k = 1; k < threads; ++k) threads_.emplace_back([this] { work(); });
    runner.struct_size = sizeof runner;
    runner.user = this;
    runner.threads = static_cast<std::uint32_t>(threads);
    runner.run = [](void* user, void (*task)(void*), void* argument, std::uint32_t count) {
      static_cast<JobSystem*>(user)->run(task, argument, count);
    };
  }
  ~JobSystem() {
    {
      const std::lock_guard lock(mutex_);
      is_stopping_ = true;
    }
    changed_.notify_all();
    for (std::thread& thread : threads_) thread.join();
  }

  stgs_task_runner runner{};
  std::atomic<int> runs{0}, calls_by_workers{0};
  std::atomic<bool> is_paused{false};

 private:
  struct Batch {
    void (*task)(void*);
    void* argument;
    std::uint32_t unstarted, running;
  };

  void run(void (*task)(void*), void* argument, std::uint32_t count) {
    ++runs;
    is_paused.wait(true);
    Batch batch{task, argument, count - 1, 0};
    std::unique_lock lock(mutex_);
    if (batch.unstarted > 0) batches_.push_back(&batch);
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
      changed_.wait(lock, [&] { return is_stopping_ || !batches_.empty(); });
      if (is_stopping_) return;
      Batch* const batch = batches_.front();
      ++batch->running;
      if (--batch->unstarted == 0) batches_.pop_front();
      lock.unlock();
      batch->task(batch->argument);
      ++calls_by_workers;
      lock.lock();
      if (--batch->running == 0) changed_.notify_all();
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Batch*> batches_;
  bool is_stopping_ = false;
  std::vector<std::thread> threads_;
};

// Counts the bytes in use, and fails one of the requests.
class CountingAllocator {
 public:
  CountingAllocator() {
    hooks.struct_size = sizeof hooks;
    hooks.user = this;
    hooks.allocate = [](void* user, std::size_t bytes, std::size_t alignment) {
      return static_cast<CountingAllocator*>(user)->allocate(bytes, alignment);
    };
    hooks.free = [](void* user, void* memory, std::size_t bytes, std::size_t) {
      static_cast<CountingAllocator*>(user)->used_bytes -= static_cast<std::int64_t>(bytes);
      std::free(memory);
    };
  }

  stgs_allocator hooks{};
  std::atomic<std::int64_t> used_bytes{0};
  std::atomic<int> requests{0}, failing_request{-1};

 private:
  void* allocate(std::size_t bytes, std::size_t alignment) {
    if (requests++ == failing_request) return nullptr;
    used_bytes += static_cast<std::int64_t>(bytes);
    return std::aligned_alloc(alignment, (bytes + alignment - 1) / alignment * alignment);
  }
};

constexpr std::uint64_t kPrimitiveBytes = (17 + 3 * 4 + 2) * sizeof(float);  // of SH degree 1

RendererPtr renderer_with(const stgs_task_runner* runner) {
  stgs_renderer_settings settings;
  REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.backend = STGS_BACKEND_CPU;
  settings.task_runner = runner;
  stgs_renderer* renderer = nullptr;
  REQUIRE(stgs_renderer_create(&settings, &renderer) == STGS_OK);
  return RendererPtr(renderer);
}

}  // namespace

TEST_CASE("the application's threads render the same image as the library's", "[sdk]") {
  const ScenePtr scene = open_scene(clip_file());
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  const auto expected = render_rgba8(cpu_renderer().get(), scene.get(), 1.0, view);
  for (const int threads : {1, 3}) {
    JobSystem jobs(threads);
    const ScenePtr own = open_scene(clip_file());
    const RendererPtr renderer = renderer_with(&jobs.runner);
    CHECK(render_rgba8(renderer.get(), own.get(), 1.0, view) == expected);
    CHECK(jobs.runs >= 4);  // decoding, and the stages of rendering
    CHECK((jobs.calls_by_workers > 0) == (threads > 1));
  }
}

TEST_CASE("a player decodes only on the application's threads", "[sdk]") {
  JobSystem jobs(8);
  stgs_player_settings settings = player_settings();
  settings.task_runner = &jobs.runner;
  jobs.is_paused = true;
  PlayerPtr player = make_player(&settings);
  settings.task_runner = nullptr;  // the player has copied it
  REQUIRE(stgs_player_open_memory(player.get(), clip_file().data(), clip_file().size()) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  stgs_player_statistics statistics{};
  statistics.struct_size = sizeof statistics;
  REQUIRE(update_until(player.get(), 0, [&](const stgs_player_status&) {
    REQUIRE(stgs_player_get_statistics(player.get(), &statistics) == STGS_OK);
    return jobs.runs == 4 && statistics.fetched_bytes > clip_file().size() / 2;
  }));
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  // The player decodes as many segments at once as half the threads of the runner.
  CHECK(jobs.runs == 4);
  CHECK(statistics.stored_primitives == 0);
  CHECK(update(player.get(), 0).ready == 0);
  jobs.is_paused = false;
  jobs.is_paused.notify_all();
  REQUIRE(wait_until_complete(player.get(), 0));
  CHECK(update(player.get(), 0).ready == 1);
  CHECK(jobs.runs > 10);
}

TEST_CASE("a scene allocates from the application's allocator", "[sdk]") {
  CountingAllocator memory;
  stgs_scene_settings settings = scene_settings();
  settings.allocator = &memory.hooks;
  ScenePtr scene = make_scene(&settings);
  REQUIRE(stgs_scene_open_memory_copy(scene.get(), clip_file().data(), clip_file().size()) ==
          STGS_OK);
  CHECK(memory.used_bytes == static_cast<std::int64_t>(clip_file().size()));
  const RendererPtr renderer = cpu_renderer();
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  (void)render_rgba8(renderer.get(), scene.get(), 1.0, view);
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  REQUIRE(stgs_scene_get_info(scene.get(), &info) == STGS_OK);
  // memory_bytes also counts the list of visible primitives, one index per primitive.
  const std::uint64_t primitives = info.memory_bytes / (kPrimitiveBytes + sizeof(std::uint32_t));
  CHECK(primitives > 500);
  CHECK(static_cast<std::uint64_t>(memory.used_bytes) - clip_file().size() ==
        primitives * kPrimitiveBytes);
  scene.reset();
  CHECK(memory.used_bytes == 0);
}

TEST_CASE("a player allocates from the application's allocator", "[sdk]") {
  CountingAllocator memory;
  stgs_player_settings settings = player_settings();
  settings.allocator = &memory.hooks;
  const RendererPtr renderer = cpu_renderer();
  PlayerPtr player = open_player(clip_file(), &settings);
  REQUIRE(wait_until_complete(player.get(), 0));
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  (void)render_rgba8(renderer.get(), stgs_player_scene(player.get()), 0, view);
  stgs_player_statistics statistics{};
  statistics.struct_size = sizeof statistics;
  REQUIRE(stgs_player_get_statistics(player.get(), &statistics) == STGS_OK);
  CHECK(statistics.stored_primitives > 500);
  CHECK(static_cast<std::uint64_t>(memory.used_bytes) >=
        statistics.stored_primitives * kPrimitiveBytes);
  player.reset();
  CHECK(memory.used_bytes == 0);
}

TEST_CASE("a scene reports any failed allocation and renders afterwards", "[sdk]") {
  const RendererPtr renderer = cpu_renderer();
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  REQUIRE(stgs_view_resize(&view, kSdkWidth, kSdkHeight) == STGS_OK);
  const auto expected = render_rgba8(renderer.get(), open_scene(clip_file()).get(), 1.0, view);
  int failed = 0;
  for (int n = 0;; ++n) {
    CountingAllocator memory;
    memory.failing_request = n;
    stgs_scene_settings settings = scene_settings();
    settings.allocator = &memory.hooks;
    ScenePtr scene = make_scene(&settings);
    std::vector<std::uint8_t> pixels(expected.size());
    stgs_image image = empty_image();
    image.rgba8 = {pixels.data(), 0, pixels.size()};
    const auto& file = clip_file();
    stgs_result result = stgs_scene_open_memory_copy(scene.get(), file.data(), file.size());
    if (result == STGS_OK) {
      result = stgs_render(renderer.get(), scene.get(), 1.0, &view, &image, 1);
      if (result != STGS_OK) {
        CHECK(error_of(renderer.get()).result == STGS_ERROR_OUT_OF_MEMORY);
        CHECK(render_rgba8(renderer.get(), scene.get(), 1.0, view) == expected);
      }
    }
    scene.reset();
    REQUIRE(memory.used_bytes == 0);
    if (memory.requests <= n) {
      CHECK(result == STGS_OK);
      break;
    }
    REQUIRE(result == STGS_ERROR_OUT_OF_MEMORY);
    ++failed;
  }
  CHECK(failed > 50);
}

TEST_CASE("a player reports any failed allocation and retries", "[sdk]") {
  int opened = 0, read_failures = 0;
  for (int n = 0;; ++n) {
    CountingAllocator memory;
    memory.failing_request = n;
    stgs_player_settings settings = player_settings();
    settings.allocator = &memory.hooks;
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
      for (const OwnedEvent& one : take_events(player.get())) {
        if (one.event.kind != STGS_EVENT_READ_FAILED) continue;
        CHECK(one.event.result == STGS_ERROR_OUT_OF_MEMORY);
        ++read_failures;
      }
    } else {
      CHECK(result == STGS_ERROR_OUT_OF_MEMORY);
    }
    player.reset();
    REQUIRE(memory.used_bytes == 0);
    if (memory.requests <= n) break;
  }
  CHECK(opened > 100);
  CHECK(read_failures > 50);
}

TEST_CASE("an invalid task runner is rejected", "[sdk]") {
  JobSystem jobs(1);
  stgs_renderer_settings settings;
  REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
  stgs_player_settings with_runner = player_settings();
  settings.task_runner = with_runner.task_runner = &jobs.runner;
  stgs_renderer* renderer = nullptr;
  stgs_player* player = nullptr;
  jobs.runner.threads = 0;
  CHECK(stgs_renderer_create(&settings, &renderer) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_player_create(&with_runner, &player) == STGS_ERROR_ARGUMENT);
  jobs.runner.threads = 1;
  jobs.runner.struct_size = 3;
  CHECK(stgs_renderer_create(&settings, &renderer) == STGS_ERROR_STRUCT_SIZE);
  jobs.runner.struct_size = sizeof jobs.runner;
  jobs.runner.run = nullptr;
  CHECK(stgs_player_create(&with_runner, &player) == STGS_ERROR_ARGUMENT);
  CHECK(renderer == nullptr);
  CHECK(player == nullptr);
}

}  // namespace stgs::testing
