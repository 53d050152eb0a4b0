// SPDX-License-Identifier: Apache-2.0
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <numeric>
#include <set>
#include <stdexcept>
#include <string>

#include "catch.h"
#include "fixtures/loop_threads.h"
#include "raster_scene.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/fovea.h"
#include "stgs/format/raster.h"
#include "vector_targets.h"

using namespace stgs;

namespace {

RasterSettings settings_of(bool scalar) {
  RasterSettings settings;
  settings.background = {0.2f, 0.5f, 0.8f};
  settings.scalar = scalar;
  return settings;
}

// Blends every splat of the frame at every pixel, without tiles, boxes or ellipse tests.
Image blend_without_tiles(const SplatFrame& frame, const RasterSettings& settings) {
  std::vector<std::uint32_t> order(frame.splats.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(),
                   [&](auto a, auto b) { return frame.splats[a].depth < frame.splats[b].depth; });
  Image image;
  image.reshape(frame.width, frame.height, 3);
  for (int y = 0; y < frame.height; ++y) {
    for (int x = 0; x < frame.width; ++x) {
      float left = 1.0f, rgb[3] = {0, 0, 0};
      for (std::uint32_t i : order) {
        const Splat& s = frame.splats[i];
        const float alpha = math::splat_alpha(
            s.opacity, math::splat_power(s.conic, static_cast<float>(x) + 0.5f - s.mean.x,
                                         static_cast<float>(y) + 0.5f - s.mean.y));
        if (alpha == 0.0f) continue;
        if (left * (1.0f - alpha) < math::kTransmittanceMin) break;
        rgb[0] += alpha * left * s.colour.x;
        rgb[1] += alpha * left * s.colour.y;
        rgb[2] += alpha * left * s.colour.z;
        left *= 1.0f - alpha;
      }
      const float background[3] = {settings.background.x, settings.background.y,
                                   settings.background.z};
      for (int c = 0; c < 3; ++c)
        image.plane(c)[y * frame.width + x] = rgb[c] + left * background[c];
    }
  }
  return image;
}

}  // namespace

TEST_CASE("tiles change no pixel compared with blending every splat everywhere") {
  for (float spread : {0.3f, 1.2f}) {
    const auto camera = testing::scene_camera(107, 61);
    const auto set = testing::random_scene(1500, camera, 3, {1, -2.8f, spread});
    SplatFrame frame;
    RasterOutput output;
    render(set, 10.0f, camera, settings_of(true), frame, output);
    REQUIRE(frame.splats.size() > 500);
    const Image expected = blend_without_tiles(frame, settings_of(true));
    CHECK(output.colour.data == expected.data);
  }
}

TEST_CASE("tile lists are in depth order, and splats are in order of their ids") {
  const auto camera = testing::scene_camera(200, 120);
  const auto set = testing::random_scene(3000, camera, 5);
  SplatFrame frame;
  begin_frame(camera, frame);
  slice(set, 10.0f, camera, settings_of(true), 7, frame);
  bin(frame);
  REQUIRE(frame.tile_begin.back() == frame.instances.size());
  REQUIRE(frame.splats.front().id >= 7);
  for (std::size_t i = 1; i < frame.splats.size(); ++i)
    REQUIRE(frame.splats[i - 1].id < frame.splats[i].id);
  for (std::size_t tile = 0; tile + 1 < frame.tile_begin.size(); ++tile) {
    for (std::uint32_t k = frame.tile_begin[tile] + 1; k < frame.tile_begin[tile + 1]; ++k) {
      const Splat& a = frame.splats[frame.instances[k - 1]];
      const Splat& b = frame.splats[frame.instances[k]];
      REQUIRE((a.depth < b.depth || (a.depth == b.depth && a.id < b.id)));
    }
  }
}

TEST_CASE("slicing the visible candidates gives the same splats as slicing the set") {
  const auto camera = testing::scene_camera(200, 120);
  const auto set = testing::random_scene(3000, camera, 6);
  SplatFrame all, some;
  begin_frame(camera, all);
  slice(set, 4.0f, camera, settings_of(true), 0, all);
  std::vector<std::uint32_t> candidates;
  for (const Splat& s : all.splats) candidates.push_back(s.id);
  begin_frame(camera, some);
  slice(set, candidates, 4.0f, camera, settings_of(true), 0, some);
  REQUIRE(some.splats.size() == all.splats.size());
  bool same = true;
  for (std::size_t i = 0; i < all.splats.size();
       ++i)  // compares the members up to and including id
    same &= std::memcmp(&some.splats[i], &all.splats[i], offsetof(Splat, id) + 4) == 0;
  CHECK(same);
}

TEST_CASE("non-finite, huge and empty values render nothing and leave the frame finite") {
  const auto camera = testing::scene_camera(64, 48);
  auto set = testing::random_scene(8, camera, 9);
  const float nan = std::nanf(""), inf = INFINITY;
  set.position[0] = nan;
  set.log_scale[3] = inf;
  std::fill_n(&set.rotation[8], 4, 0.0f);
  set.velocity[9] = inf;
  set.opacity_logit[4] = nan;
  set.sigma[5] = nan;
  set.position[18] = 1e30f;
  set.log_scale[21] = 60.0f;
  SplatFrame frame;
  RasterOutput output;
  for (bool scalar : {true, false}) render(set, 10.0f, camera, settings_of(scalar), frame, output);
  for (float v : output.colour.data) REQUIRE(std::isfinite(v));
  set.resize(0);
  render(set, 10.0f, camera, settings_of(false), frame, output);
  CHECK(output.colour.data[0] == 0.2f);
  CHECK(output.alpha.data[0] == 0.0f);
  CHECK(output.depth.data[0] == 0.0f);
}

TEST_CASE("a splat with a non-finite depth, distance or colour is not rendered") {
  const auto camera = testing::scene_camera(64, 48);
  Gaussians4D one;
  one.resize(1);
  one.position = {0.0f, 0.0f, 5.0f};
  one.log_scale = {-1.0f, -1.0f, -1.0f};
  one.rotation = {1.0f, 0.0f, 0.0f, 0.0f};
  one.opacity_logit = {3.0f};
  one.sigma = {10.0f};
  math::PinholeCamera forward = camera;
  forward.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  forward.translation = {0, 0, 0};
  const auto count_splats = [&] {
    SplatFrame frame;
    begin_frame(forward, frame);
    slice(one, 0.0f, forward, settings_of(true), 0, frame);
    return frame.splats.size();
  };
  CHECK(count_splats() == 1);
  one.sh[1] = 3e38f;
  one.sh[2] = -3e38f;
  CHECK(count_splats() == 1);  // huge but finite
  one.sh_degree = 1;
  one.sh.assign(12, 0.0f);
  one.sh[0] = one.sh[6] = 3e38f;
  one.sh[3] = one.sh[9] = 3e38f;
  one.position = {2.0f, -2.0f, 5.0f};
  forward.fx = forward.fy = 10.0f;
  CHECK(count_splats() == 1);
  for (float& v : one.sh) v = 0.0f;
  one.sh[6] = std::nanf("");
  CHECK(count_splats() == 0);
  one.sh[6] = INFINITY;
  CHECK(count_splats() == 0);
  one.sh[6] = 0.0f;
  CHECK(count_splats() == 1);
  one.position = {0.0f, 0.0f, 3e38f};  // its squared distance overflows
  CHECK(count_splats() == 0);
  const float half = std::sqrt(0.5f);
  forward.rotation = {half, 0, -half, 0, 1, 0, half, 0, half};
  one.position = {3e38f, 0.0f, 3e38f};  // its depth overflows
  CHECK(count_splats() == 0);
}

TEST_CASE("bin() rejects a frame with more than 2^26 tile instances while using less than 1 GiB") {
  math::PinholeCamera camera = testing::scene_camera(8192, 8192);
  SplatFrame frame;
  begin_frame(camera, frame);
  Splat everywhere{};
  everywhere.mean = {4096, 4096};
  everywhere.conic = {1e-9f, 0.0f, 1e-9f};
  everywhere.extent = {1e5f, 1e5f};
  everywhere.opacity = 1.0f;
  everywhere.depth = 1.0f;
  everywhere.reach = 5.0f;
  frame.splats.assign(257, everywhere);  // 512 x 512 tiles each
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const long before = usage.ru_maxrss;
  CHECK_THROWS_AS(bin(frame), std::length_error);
  getrusage(RUSAGE_SELF, &usage);
#ifndef __SANITIZE_THREAD__                   // its shadow memory is several times as large
  CHECK(usage.ru_maxrss - before < 1 << 20);  // KiB
#endif
  CHECK(frame.scratch.bin_chunks.empty());  // the oversized scratch memory is released
  frame.splats.resize(3);
  bin(frame);
  CHECK(frame.instances.size() == 3 * 512 * 512);
}

namespace {

void compare_with_reference() {
  const int sizes[][2] = {{160, 96}, {107, 61}, {16, 16}, {5, 3}, {333, 17}};
  for (const auto& size : sizes) {
    for (float spread : {0.3f, 1.2f}) {
      const auto camera = testing::scene_camera(size[0], size[1]);
      const auto set = testing::random_scene(3000, camera, 21, {2, -2.8f, spread});
      SplatFrame frame;
      RasterOutput reference, vector;
      render(set, 10.0f, camera, settings_of(true), frame, reference);
      blend(frame, settings_of(false), vector);
      double square = 0;
      float worst = 0, worst_alpha = 0, worst_left = 0;
      for (std::size_t k = 0; k < vector.colour.data.size(); ++k) {
        const float d = std::abs(vector.colour.data[k] - reference.colour.data[k]);
        square += static_cast<double>(d) * d;
        worst = std::max(worst, d);
      }
      for (std::size_t k = 0; k < vector.alpha.data.size(); ++k) {
        worst_alpha =
            std::max(worst_alpha, std::abs(vector.alpha.data[k] - reference.alpha.data[k]));
        worst_left = std::max(
            worst_left, std::abs(vector.transmittance.data[k] - reference.transmittance.data[k]));
      }
      const double psnr =
          -10.0 * std::log10(square / static_cast<double>(vector.colour.data.size()) + 1e-20);
      INFO(size[0] << " x " << size[1] << " on " << vector_target() << ": " << psnr << " dB, worst "
                   << worst);
      CHECK(psnr >= 70.0);
      // A splat at the threshold may be rendered by one and not by the other; two at one pixel are
      // rare.
      CHECK(worst <= 4.0f / 255.0f);
      CHECK(worst_alpha <= 2.0f / 255.0f);
      CHECK(worst_left <= 2.0f / 255.0f);
    }
  }
}

}  // namespace

TEST_CASE("every vector target renders the reference image") {
  std::set<std::string> targets;
  testing::for_each_vector_target([&] {
    targets.insert(vector_target());
    compare_with_reference();
  });
  CHECK(targets.size() == hwy::SupportedAndGeneratedTargets().size());
}

TEST_CASE("beyond the fovea, 2 x 2 pixels share one colour, which is close to their mean") {
  const auto camera = testing::scene_camera(203, 121);
  const auto set = testing::random_scene(3000, camera, 9, {1, -2.8f, 0.6f});
  for (const bool scalar : {true, false}) {
    SplatFrame frame;
    RasterOutput full, halved;
    RasterSettings settings = settings_of(scalar);
    render(set, 10.0f, camera, settings, frame, full);
    settings.fovea = Fovea{{90.0f, 60.0f}, 30.0f};
    blend(frame, settings, halved);
    double squares = 0;
    int full_resolution = 0, compared = 0;
    for (int y = 0; y + 1 < frame.height; y += 2) {
      for (int x = 0; x + 1 < frame.width; x += 2) {
        const auto beyond =
            math::beyond_fovea(settings.fovea->centre, settings.fovea->radius,
                               static_cast<float>(x / 32 * 32), static_cast<float>(y / 32 * 32));
        const int square[] = {y * frame.width + x, y * frame.width + x + 1,
                              (y + 1) * frame.width + x, (y + 1) * frame.width + x + 1};
        for (int c = 0; c < 3; ++c) {
          const float *exact = full.colour.plane(c), *half = halved.colour.plane(c);
          float mean = 0;
          for (const int p : square) {
            mean += 0.25f * exact[p];
            if (beyond) {
              REQUIRE(half[p] == half[square[0]]);
            } else {
              REQUIRE(half[p] == exact[p]);
            }
          }
          if (!beyond) continue;
          squares += (mean - half[square[0]]) * (mean - half[square[0]]);
          ++compared;
        }
        full_resolution += !beyond;
      }
    }
    CHECK(full_resolution > 500);
    CHECK(compared > 9000);
    INFO("scalar: " << scalar << ", " << -10 * std::log10(squares / compared) << " dB");
    CHECK(-10 * std::log10(squares / compared) > 38);
  }
}

TEST_CASE("one thread and two render the same bits") {
  const auto camera = testing::scene_camera(320, 180);
  const auto set = testing::random_scene(20000, camera, 11);
  for (bool scalar : {true, false}) {
    SplatFrame frame[2];
    RasterOutput output[2];
    for (int threads : {1, 2}) {
      const testing::LoopThreads limit(threads);
      render(set, 10.0f, camera, settings_of(scalar), frame[threads - 1], output[threads - 1]);
    }
    CHECK(frame[0].instances == frame[1].instances);
    CHECK(output[0].colour.data == output[1].colour.data);
    CHECK(output[0].depth.data == output[1].depth.data);
    CHECK(output[0].last == output[1].last);
  }
}
