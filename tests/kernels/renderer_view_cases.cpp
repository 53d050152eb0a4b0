// SPDX-License-Identifier: Apache-2.0
// A device's renderer against the CPU renderer (spec/representation.md, 7.2): views and foveae.
#include "renderer_cases.h"

using namespace stgs;
using namespace stgs::player;
using namespace stgs::testing;

TEST_CASE("several views rendered together have the bits of the views rendered alone") {
  const auto device = device_renderer();
  const auto timeline = make_timeline(random_scene(2500, 3, kFrames, 8));
  std::vector<View> views = {make_view(64, 48), make_view(201, 32), make_view(64, 48),
                             make_view(5, 97)};
  views[2].camera.translation.x += 0.3f;
  check_matches_cpu(*timeline, 1.1, views, *device);
  const std::vector<Frame> together = render_views(*device, *timeline, 1.1, views);
  for (std::size_t i = 0; i < views.size(); ++i) {
    CHECK(identical(render_views(*device, *timeline, 1.1, {views[i]})[0], together[i]));
  }
}

TEST_CASE(
    "two eyes with asymmetric frusta match the CPU renderer and have the bits of each eye alone") {
  const auto device = device_renderer();
  const auto timeline = make_timeline(random_scene(9000, 3, kFrames, 14));
  // The frusta of a headset: off-centre in both axes, with the nose side closer to the edge of the
  // frame.
  std::vector<View> eyes = {make_view(172, 184), make_view(172, 184)};
  for (int k = 0; k < 2; ++k) {
    math::PinholeCamera& camera = eyes[k].camera;
    camera.translation.x += k == 0 ? 0.03f : -0.03f;
    camera.cx += k == 0 ? 19.25f : -19.25f;
    camera.cy -= 11.5f;
    camera.fx *= k == 0 ? 1.0f : 1.02f;
  }
  for (const double seconds : {0.0, 0.81, 1.9}) {
    check_matches_cpu(*timeline, seconds, eyes, *device);
    const std::vector<Frame> both = render_views(*device, *timeline, seconds, eyes);
    for (std::size_t k = 0; k < 2; ++k) {
      CHECK(identical(render_views(*device, *timeline, seconds, {eyes[k]})[0], both[k]));
    }
  }
}

TEST_CASE("pixels beyond the fovea have half resolution, as on the CPU") {
  const auto device = device_renderer(), variant = device_renderer({.variant = true});
  const auto timeline = make_timeline(random_scene(4000, 1, kFrames, 29));
  View left = make_view(333, 211), right = make_view(149, 100);
  left.fovea = Fovea{{140.5f, 97.0f}, 61.0f};
  right.fovea = Fovea{{-40.0f, 20.0f}, 0.0f};  // the complete view at half resolution
  const View full = make_view(101, 67);
  check_matches_cpu(*timeline, 0.97, {left, full, right}, *device);
  check_matches_cpu(*timeline, 0.97, {left, right}, *variant);
  const auto check_identical = [&](Renderer& a, const std::vector<View>& views, Renderer& b,
                                   const std::vector<View>& others) {
    const std::vector<Frame> of_a = render_views(a, *timeline, 0.97, views);
    const std::vector<Frame> of_b = render_views(b, *timeline, 0.97, others);
    for (std::size_t i = 0; i < of_a.size(); ++i) CHECK(identical(of_a[i], of_b[i]));
  };
  check_identical(*device, {left, full, right}, *variant, {left, full, right});
  View everywhere = left, nowhere = left;
  everywhere.fovea->radius = 1e6f;
  nowhere.fovea.reset();
  check_identical(*device, {everywhere}, *device, {nowhere});
}

TEST_CASE("a fovea may have any centre and radius") {
  const auto device = device_renderer();
  const auto timeline = make_timeline(random_scene(2000, 1, kFrames, 31));
  View view = make_view(150, 115);
  const Fovea foveae[] = {{{75.0f, -1e9f}, 1e9f},
                          {{75.0f, 1e6f}, 1e6f},
                          {{1e30f, 0.0f}, 3e38f},
                          {{96.0f, 64.0f}, 32.0f},
                          {{-3e38f, 3e38f}, INFINITY}};
  for (const Fovea& fovea : foveae) {
    INFO("centre " << fovea.centre.x << ", " << fovea.centre.y << ", radius " << fovea.radius);
    view.fovea = fovea;
    check_matches_cpu(*timeline, 0.5, {view, make_view(40, 30)}, *device);
  }
}

TEST_CASE("tile lists of any length are rendered inside and beyond a fovea") {
  const auto device = device_renderer();
  Scene scene = static_scene(8000);
  Gaussians4D& set = scene.gaussians;
  // Faint primitives in piles of 5200, 1500 and 500, each a few pixels wide; the others cover the
  // view.
  const struct {
    std::size_t end;
    float x, y;
  } piles[] = {{5200, -1.5f, -1.0f}, {6700, 1.5f, -1.0f}, {7200, -1.4f, 1.2f}};
  std::size_t i = 0;
  for (const auto& pile : piles) {
    for (; i < pile.end; ++i) {
      const float at[] = {pile.x, pile.y, 5.0f};
      for (std::size_t c = 0; c < 3; ++c) {
        float& x = set.position[3 * i + c];
        x = at[c] + 0.05f * (x - (c == 2 ? 5.0f : 0.0f));
      }
      set.opacity_logit[i] = -3.0f;
    }
  }
  const auto timeline = make_timeline(scene);
  View off_pile = make_view(320, 240), on_pile = off_pile;
  off_pile.fovea = Fovea{{200.0f, 180.0f}, 40.0f};
  on_pile.fovea = Fovea{{80.0f, 70.0f}, 50.0f};
  check_matches_cpu(*timeline, 0.7, {off_pile, on_pile}, *device);
  View large = make_view(1037, 523);  // more squares than one workgroup covers
  large.fovea = Fovea{{260.0f, 150.0f}, 140.0f};
  check_matches_cpu(*timeline, 0.7, {large, on_pile}, *device);
  CHECK(identical(render_views(*device, *timeline, 0.7, {on_pile})[0],
                  render_views(*device, *timeline, 0.7, {off_pile, on_pile})[1]));
}

TEST_CASE("the number of views may change from call to call, and a view may show nothing") {
  const auto device = device_renderer();
  const auto timeline = make_timeline(random_scene(3000, 1, kFrames, 15));
  View empty = make_view(70, 50);
  empty.camera.translation.z = -1e4f;
  const View views[] = {make_view(33, 90), empty, make_view(120, 16), make_view(48, 48)};
  std::vector<Frame> alone;
  for (const View& view : views) alone.push_back(render_views(*device, *timeline, 0.6, {view})[0]);
  CHECK(*std::max_element(alone[1].alpha.data.begin(), alone[1].alpha.data.end()) == 0.0f);
  for (const std::size_t count : {4, 1, 3, 2, 4}) {
    const std::vector<Frame> frames =
        render_views(*device, *timeline, 0.6, std::vector<View>(views, views + count));
    for (std::size_t i = 0; i < count; ++i) CHECK(identical(frames[i], alone[i]));
  }
}
