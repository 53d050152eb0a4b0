// SPDX-License-Identifier: Apache-2.0
// The CUDA renderer with little GPU memory: it fails with a status, and works again afterwards.
#include <cstdio>

#include "memory_hog.h"
#include "renderer_cases.h"

using namespace stgs;
using namespace stgs::player;
using namespace stgs::testing;

namespace {

constexpr std::size_t kMiB = std::size_t{1} << 20;

bool is_clean(const Status& status) {
  return status.ok() || status.code() == StatusCode::kRuntime ||
         status.code() == StatusCode::kUnsupported || status.code() == StatusCode::kNoMemory ||
         status.code() == StatusCode::kLimit;
}

}  // namespace

TEST_CASE("a renderer survives any limit of its memory") {
  const auto timeline = make_timeline(random_scene(200000, 3, kFrames, 12));
  const View view = make_view(1920, 1080);
  const Frame expected = render_views(*device_renderer(), *timeline, 1.0, {view})[0];
  const auto renderer = device_renderer();
  int failures = 0;
  for (std::size_t limit = 0; limit <= 512 * kMiB; limit += limit < 64 * kMiB ? kMiB : 32 * kMiB) {
    INFO("with a limit of " << limit / kMiB << " MiB");
    const auto limited = make_timeline(random_scene(200000, 3, kFrames, 12));
    limited->budget()->set_limit(Budget::Pool::kRenderer, limit);
    const Status drawn = renderer->draw(*limited, 1.0, {view}, nullptr);
    INFO(drawn.message());
    CHECK((drawn.ok() || drawn.code() == StatusCode::kLimit));
    failures += drawn.ok() ? 0 : 1;
    CHECK(identical(render_views(*renderer, *timeline, 1.0, {view})[0], expected));
  }
  std::printf("  %d of the limits were exceeded\n", failures);
  CHECK(failures > 0);
}

TEST_CASE("a renderer survives any lack of GPU memory") {
  const auto timeline = make_timeline(random_scene(200000, 3, kFrames, 12));
  const View view = make_view(1920, 1080);
  const Frame expected = render_views(*device_renderer(), *timeline, 1.0, {view})[0];
  int failures = 0;
  for (std::size_t left = 0; left <= 512 * kMiB; left += left < 64 * kMiB ? 2 * kMiB : 32 * kMiB) {
    INFO("with " << left / kMiB << " MiB of GPU memory");
    std::unique_ptr<Renderer> made, before = device_renderer();
    {
      const MemoryHog hog(left);
      auto renderer = make_renderer_under_test({});
      CHECK(is_clean(renderer.status()));
      if (renderer.ok()) {
        made = std::move(*renderer);
        const Status drawn = made->draw(*timeline, 1.0, {view}, nullptr);
        INFO(drawn.message());
        CHECK(is_clean(drawn));
        failures += drawn.ok() ? 0 : 1;
      } else {
        ++failures;
      }
      CHECK(is_clean(before->draw(*timeline, 1.0, {view}, nullptr)));
    }
    if (made != nullptr) CHECK(identical(render_views(*made, *timeline, 1.0, {view})[0], expected));
    CHECK(identical(render_views(*before, *timeline, 1.0, {view})[0], expected));
  }
  std::printf("  %d of the attempts failed\n", failures);
  CHECK(failures > 0);
}
