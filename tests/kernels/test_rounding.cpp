// SPDX-License-Identifier: Apache-2.0
// Training with quantisation in the loop renders what a decoder of the packed scene reconstructs.
#include "train/rounding.h"

#include <cmath>

#include "backend/backend.h"
#include "catch.h"
#include "container/container.h"
#include "rounded_state.h"
#include "stgs/format/math/quant.h"
#include "stgs/format/scene_file.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

constexpr std::uint32_t kFrames = 20;

TrainState random_state(std::size_t n) {
  SceneShape shape;
  shape.sh_degree = 3;
  return train_state(random_scene(n, scene_camera(160, 96), 5, shape), 3);
}

Scene scene_of(const TrainState& state) {
  Scene scene;
  scene.gaussians = rounded_set(state);
  scene.importance = state.compaction.importance;
  scene.quantisation = state.compaction.quantisation;
  scene.metadata.frames = kFrames;
  return scene;
}

// Packs a scene with its own steps; `order` receives the scene index of each primitive of the file.
Scene packed(const Scene& scene, std::vector<std::uint32_t>& order) {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.own_steps = true;
  const auto bytes = encode_scene(scene, settings, &order);
  REQUIRE(bytes.ok());
  const Result<Scene> read = read_scene(memory_source(*bytes, "packed"));
  REQUIRE(read.ok());
  return *read;
}

double greatest_difference(const FloatArray& a, const FloatArray& b, std::size_t components,
                           const std::vector<std::uint32_t>& order) {
  double greatest = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (std::size_t c = 0; c < components; ++c) {
      greatest = std::max(greatest,
                          std::abs(double{a[components * order[i] + c]} - b[components * i + c]));
    }
  }
  return greatest;
}

}  // namespace

TEST_CASE("a scene that was trained for its steps is packed without further loss") {
  TrainState state = random_state(2000);
  begin_rounding(state, kFrames, 80);
  const Scene scene = scene_of(state);
  std::vector<std::uint32_t> order;
  const Scene decoded = packed(scene, order);
  const Gaussians4D &was = scene.gaussians, &is = decoded.gaussians;
  CHECK(100 * order.size() > 99 * was.size());  // the others are never visible
  CHECK(greatest_difference(was.position, is.position, 3, order) < 1e-5);
  CHECK(greatest_difference(was.velocity, is.velocity, 3, order) < 1e-6);
  CHECK(greatest_difference(was.opacity_logit, is.opacity_logit, 1, order) < 1e-6);
  CHECK(greatest_difference(was.sh, is.sh, 48, order) < 1e-6);
  CHECK(greatest_difference(was.time, is.time, 1, order) < 1e-6);
  CHECK(greatest_difference(was.sigma, is.sigma, 1, order) < 1e-6);
  // A hard edge between two frames may move within them, because the opacity was rounded.
  CHECK(greatest_difference(was.radius, is.radius, 1, order) < 1);
  // Another quality chooses other steps.
  Scene other = scene;
  other.quantisation.reset();
  CHECK(greatest_difference(was.sh, packed(other, order).gaussians.sh, 48, order) > 1e-3);
}

TEST_CASE("steps out of range are rejected, also in a file") {
  TrainState state = random_state(300);
  begin_rounding(state, kFrames, 70);
  const Scene scene = scene_of(state);
  const auto bytes = encode_scene(scene, {});
  REQUIRE(bytes.ok());
  using Change = void (*)(Quantisation&);
  const Change changes[] = {
      [](Quantisation& q) { q.opacity.exponent = -100; },  // rounding up would take forever
      [](Quantisation& q) { q.lifespans.time = 1e9; },
      [](Quantisation& q) { q.tiers[0].position.multiplier = 2; },
      [](Quantisation& q) { q.bounds[0] = -1; }, [](Quantisation& q) { q.quality = std::nan(""); }};
  for (const Change change : changes) {
    Scene changed = scene;
    change(*changed.quantisation);
    CHECK(encode_scene(changed, {}).status().code() == StatusCode::kUsage);
  }
  // The record of the file with every byte changed in turn, and valid checksums.
  const auto parsed_from = [](const std::vector<std::uint8_t>& record) {
    FileHead head;
    parse_steps(record, head);
    return head.quantisation;
  };
  const std::vector<std::uint8_t> payload = write_steps(*scene.quantisation);
  for (std::size_t at = 0; at < payload.size(); ++at) {
    std::vector<std::uint8_t> changed = payload;
    changed[at] ^= 0x55;
    const std::optional<Quantisation> parsed = parsed_from(changed);
    CHECK((!parsed || is_valid(*parsed)));
    changed.resize(at);
    CHECK_FALSE(parsed_from(changed));
  }
}

TEST_CASE("the steps of a scene survive a file") {
  TrainState state = random_state(300);
  begin_rounding(state, kFrames, 70);
  const Scene scene = scene_of(state);
  auto bytes = encode_scene(scene, {});
  REQUIRE(bytes.ok());
  const Result<Scene> read = read_scene(memory_source(*bytes, "lossless"));
  REQUIRE(read.ok());
  CHECK(read->quantisation == scene.quantisation);
  const auto issues = validate_scene(*memory_source(*bytes, "lossless"));
  REQUIRE(issues.ok());
  CHECK(issues->empty());
}

TEST_CASE("retaining primitives retains their tiers and importances") {
  TrainState state = random_state(100);
  begin_rounding(state, kFrames, 80);
  const CompactionState before = state.compaction;
  state.retain({3, 50, 99});
  CHECK(state.compaction.importance ==
        std::vector<float>{before.importance[3], before.importance[50], before.importance[99]});
  CHECK(state.compaction.tier ==
        std::vector<std::uint8_t>{before.tier[3], before.tier[50], before.tier[99]});
}

TEST_CASE("rounding twice changes nothing") {
  TrainState state = random_state(1000);
  begin_rounding(state, kFrames, 80);
  const Gaussians4D once = rounded_set(state);
  state.set = once;
  const Gaussians4D twice = rounded_set(state);
  CHECK(twice.position == once.position);
  CHECK(twice.log_scale == once.log_scale);
  CHECK(twice.sh == once.sh);
  CHECK(twice.opacity_logit == once.opacity_logit);
}

TEST_CASE("the scale of displacements is a power of two of the lifespan") {
  for (const float sigma : {1e-3f, 0.5f, 0.999f, 1.0f, 1.5f, 2.0f, 59.9f, 1e6f}) {
    const float lifespan = std::max(2.0f * sigma, 1.0f);  // that of a radius of 0 is 1
    const float scale = math::displacement_scale(sigma, 0.0f, 1e9f);
    CHECK(lifespan * scale >= 1.0f);
    CHECK(lifespan * scale < 2.0f);
    CHECK(std::exp2(std::round(std::log2(scale))) == scale);
  }
  CHECK(math::displacement_scale(100.0f, 0.0f, 16.0f) == 0.0625f);
}

TEST_CASE("the gradient of the rate is that of luma and chroma") {
  const auto rate = [](math::Vec3 rgb) {
    const math::Vec3 v = math::luma_chroma(rgb);
    return 2.0f * std::abs(v.x) + 3.0f * (std::abs(v.y) + std::abs(v.z));
  };
  for (const math::Vec3 rgb : {math::Vec3{0.3f, -0.2f, 0.7f}, math::Vec3{-0.5f, 0.4f, 0.1f}}) {
    const math::Vec3 by = math::colour_rate_grad(rgb, 2.0f, 3.0f);
    const float h = 1e-3f;
    CHECK(by.x ==
          Approx((rate({rgb.x + h, rgb.y, rgb.z}) - rate({rgb.x - h, rgb.y, rgb.z})) / (2 * h))
              .epsilon(1e-3));
    CHECK(by.y ==
          Approx((rate({rgb.x, rgb.y + h, rgb.z}) - rate({rgb.x, rgb.y - h, rgb.z})) / (2 * h))
              .epsilon(1e-3));
    CHECK(by.z ==
          Approx((rate({rgb.x, rgb.y, rgb.z + h}) - rate({rgb.x, rgb.y, rgb.z - h})) / (2 * h))
              .epsilon(1e-3));
  }
  const math::Vec3 none = math::colour_rate_grad({0, 0, 0}, 2.0f, 3.0f);
  CHECK((none.x == 0 && none.y == 0 && none.z == 0));
}

TEST_CASE("a step renders rounded values and changes the learnt ones") {
  const Image8 image = random_ground_truth(160, 96, 100);
  const auto backend = make_cpu_backend();
  const auto step = [&](TrainState& state, float weight_rate) {
    StepInput input = train_step(scene_camera(160, 96), image, 8.0f, 3);
    input.weight_rate = weight_rate;
    REQUIRE(backend->begin(state).ok());
    REQUIRE(backend->step(input).ok());
    return backend->read()->front();
  };
  TrainState rounding = random_state(1000);
  begin_rounding(rounding, kFrames, 60);
  TrainState plain = rounding;
  plain.compaction = {};
  plain.set = rounded_set(rounding);
  const TrainState before = rounding;
  const StepOutput expected = step(plain, 0), found = step(rounding, 0);
  CHECK(found.loss == expected.loss);
  CHECK(rounding.moments[kPosition].first == plain.moments[kPosition].first);
  CHECK(rounding.moments[kSh].first == plain.moments[kSh].first);
  // Both moved by the same step, from different values.
  std::size_t moved = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (rounding.updates[i] == 0) continue;
    ++moved;
    CHECK(rounding.set.position[3 * i] - before.set.position[3 * i] ==
          Approx(plain.set.position[3 * i] - rounded_set(before).position[3 * i]).margin(1e-6));
    if (moved == 50) break;
  }
  CHECK(moved == 50);
  // The rate adds its weight times the bits per unit.
  TrainState rated = before;
  step(rated, 1e-3f);
  bool differs = false;
  for (std::size_t i = 0; i < before.size() && !differs; ++i) {
    if (rated.updates[i] == 0) continue;
    const std::size_t at = 48 * i + 3;
    const RoundingSteps& steps = before.compaction.rules.tiers[before.compaction.tier[i]];
    const math::Vec3 by =
        math::colour_rate_grad({before.set.sh[at], before.set.sh[at + 1], before.set.sh[at + 2]},
                               steps.luma_bits[1], steps.chroma_bits[1]);
    CHECK(rated.moments[kSh].first[at] ==
          Approx(rounding.moments[kSh].first[at] + 0.1f * 1e-3f * by.x).margin(1e-9));
    differs = true;
  }
  CHECK(differs);
}
