// SPDX-License-Identifier: Apache-2.0
// Renders the files of the conformance suite, including the damaged ones that remain readable, and
// compares the device with the CPU renderer.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <vector>

#include "catch.h"
#include "frame_difference.h"
#include "renderer_under_test.h"
#include "stgs/format/math/lifespan.h"

using namespace stgs;
using namespace stgs::player;
using namespace stgs::testing;

namespace {

// The bounding box of the primitives that are active at a time, or [-1, 1]^3 if there is none.
struct Box {
  math::Vec3 low{-1, -1, -1}, high{1, 1, 1};
};
Box active_bounds(Timeline& timeline, double seconds) {
  const auto active = timeline.at(seconds);
  if (!active.ok()) return {};
  constexpr float kFar = 1e30f;
  Box box{{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}};
  for (const Timeline::Active::Segment& part : active->segments) {
    for (const std::uint32_t i : *part.candidates) {
      const float* x = &part.set->position[3 * i];
      const float* u = &part.set->velocity[3 * i];
      const math::Vec3 at = math::position_at({x[0], x[1], x[2]}, {u[0], u[1], u[2]},
                                              static_cast<float>(part.ticks - part.set->time[i]));
      box.low = {std::min(box.low.x, at.x), std::min(box.low.y, at.y), std::min(box.low.z, at.z)};
      box.high = {std::max(box.high.x, at.x), std::max(box.high.y, at.y),
                  std::max(box.high.z, at.z)};
    }
  }
  return box.low.x <= box.high.x ? box : Box{};
}

// A view along z of the complete box.
View view_of(const Box& box) {
  const math::Vec3 size{box.high.x - box.low.x, box.high.y - box.low.y, box.high.z - box.low.z};
  const float radius = std::max(0.5f, std::sqrt(math::dot3(size, size)) / 2);
  View view{};
  view.camera.rotation = math::rotation_of({1.0f, 0.0f, 0.0f, 0.0f});
  view.camera.translation = {-(box.low.x + box.high.x) / 2, -(box.low.y + box.high.y) / 2,
                             2.5f * radius - (box.low.z + box.high.z) / 2};
  view.camera.width = 96.0f;
  view.camera.height = 64.0f;
  view.camera.fx = view.camera.fy = 70.0f;
  view.camera.cx = 48.0f;
  view.camera.cy = 32.0f;
  view.camera.near_plane = 0.01f;
  view.background = {0.2f, 0.5f, 0.7f};
  return view;
}

struct SuiteCounts {
  int files = 0, frames = 0, rejected = 0;
  int with_splats = 0;  // frames that show more than the background
  double min_psnr = 200;
};

// Renders one time on both, each from its own timeline, because a timeline reports damage once.
void compare_frames(Timeline& on_cpu, Timeline& on_device, double seconds, Renderer& cpu,
                    Renderer& device, SuiteCounts& counts) {
  const std::vector<View> views{view_of(active_bounds(on_cpu, seconds))};
  std::vector<Frame> expected, found;
  const Status a = cpu.render(on_cpu, seconds, views, expected, nullptr);
  const Status b = device.render(on_device, seconds, views, found, nullptr);
  INFO(seconds << " s: " << a.message() << " / " << b.message());
  CHECK(a.code() == b.code());
  if (!a.ok() || !b.ok()) {
    ++counts.rejected;
    return;
  }
  const FrameDifference d = difference(expected[0], found[0]);
  INFO(d.text());
  CHECK(d.agrees());
  counts.min_psnr = std::min(counts.min_psnr, d.psnr);
  ++counts.frames;
  const auto& alpha = found[0].alpha.data;
  counts.with_splats += *std::max_element(alpha.begin(), alpha.end()) > 0.05f;
}

}  // namespace

TEST_CASE(
    "on every conformance file the device renderer matches the CPU renderer or returns the same "
    "error") {
  const char* const path = std::getenv("STGS_VECTORS");
  const std::filesystem::path folder = path != nullptr ? path : "tests/conformance/vectors";
  REQUIRE(std::filesystem::is_directory(folder));
  const auto cpu = std::move(*make_renderer("cpu"));
  auto device = make_renderer_under_test({});
  REQUIRE(device.ok());
  SuiteCounts counts;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    // Spec 6.1 leaves it to the reader whether to render this file; the GPU decoder does.
    if (entry.path().stem() == "planes_checksum") continue;
    const auto open = [&] {
      return Timeline::open(entry.path().string(), kDefaultMemoryBudget, DamagePolicy::kSkip);
    };
    auto on_cpu = open(), on_device = open();
    if (!on_cpu.ok()) continue;
    INFO(entry.path().filename().string());
    REQUIRE(on_device.ok());
    ++counts.files;
    const double duration = (*on_cpu)->duration_seconds();
    for (const double fraction : {0.0, 0.5, 0.9}) {
      compare_frames(**on_cpu, **on_device, fraction * duration, *cpu, **device, counts);
    }
    CHECK((*on_cpu)->segment_damage().size() == (*on_device)->segment_damage().size());
  }
  std::printf("  %d files, %d frames, %d with splats, %d rejected, at least %.1f dB\n",
              counts.files, counts.frames, counts.with_splats, counts.rejected, counts.min_psnr);
  CHECK(counts.files > 60);
  CHECK(counts.with_splats > 100);
}
