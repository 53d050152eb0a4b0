// SPDX-License-Identifier: Apache-2.0
// The files of the conformance suite, also the damaged ones that can be read past, as a device's
// renderer and the CPU renderer draw them.
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

// Where what is alive is at the moment: the box around all of it, or of [-1, 1].
struct Box {
  math::Vec3 low{-1, -1, -1}, high{1, 1, 1};
};
Box box_at(Timeline& timeline, double seconds) {
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

// Looks along z at all of what is alive.
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

struct Drawn {
  int files = 0, pictures = 0, refused = 0;
  int with_splats = 0;  // pictures that are not the background alone
  double least_psnr = 200;
};

// Draws a moment with both, each of a timeline of its own, as what is passed over is told once.
void draw_alike(Timeline& here, Timeline& there, double seconds, Renderer& cpu, Renderer& device,
                Drawn& drawn) {
  const std::vector<View> views{view_of(box_at(here, seconds))};
  std::vector<Frame> expected, found;
  const Status a = cpu.render(here, seconds, views, expected, nullptr);
  const Status b = device.render(there, seconds, views, found, nullptr);
  INFO(seconds << " s: " << a.message() << " / " << b.message());
  CHECK(a.code() == b.code());
  if (!a.ok() || !b.ok()) {
    ++drawn.refused;
    return;
  }
  const FrameDifference d = difference(expected[0], found[0]);
  INFO(d.text());
  CHECK(d.agrees());
  drawn.least_psnr = std::min(drawn.least_psnr, d.psnr);
  ++drawn.pictures;
  const auto& alpha = found[0].alpha.data;
  drawn.with_splats += *std::max_element(alpha.begin(), alpha.end()) > 0.05f;
}

}  // namespace

TEST_CASE("the files of the conformance suite look like the CPU's, or are refused as by it") {
  const char* const given = std::getenv("STGS_VECTORS");
  const std::filesystem::path folder = given != nullptr ? given : "tests/conformance/vectors";
  REQUIRE(std::filesystem::is_directory(folder));
  const auto cpu = std::move(*make_renderer("cpu"));
  auto device = make_renderer_under_test({});
  REQUIRE(device.ok());
  Drawn drawn;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    // A reader may show it or not (spec 6.1), and a GPU that decodes it does.
    if (entry.path().stem() == "planes_checksum") continue;
    const auto open = [&] {
      return Timeline::open(entry.path().string(), kDefaultMemoryBudget, DamagePolicy::kSkip);
    };
    auto here = open(), there = open();
    if (!here.ok()) continue;
    INFO(entry.path().filename().string());
    REQUIRE(there.ok());
    ++drawn.files;
    const double duration = (*here)->duration_seconds();
    for (const double share : {0.0, 0.5, 0.9}) {
      draw_alike(**here, **there, share * duration, *cpu, **device, drawn);
    }
    CHECK((*here)->segment_damage().size() == (*there)->segment_damage().size());
  }
  std::printf("  %d files, %d pictures, %d of splats, %d moments refused, %.1f dB at least\n",
              drawn.files, drawn.pictures, drawn.with_splats, drawn.refused, drawn.least_psnr);
  CHECK(drawn.files > 60);
  CHECK(drawn.with_splats > 100);
}
