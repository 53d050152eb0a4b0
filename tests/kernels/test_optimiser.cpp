// SPDX-License-Identifier: Apache-2.0
// Adam, colour correction, regularisers, damping, and the limits and schedules of a training run.
#include <cmath>
#include <filesystem>
#include <fstream>

#include "backend/cpu/adam_primitive.h"
#include "backend/cpu/regularisers.h"
#include "catch.h"
#include "fixtures/temporary_folder.h"
#include "random_train_state.h"
#include "stgs/format/math/blend.h"
#include "train/adam.h"
#include "train/colour_correction.h"
#include "train/densify_plan.h"
#include "train/machine_memory.h"
#include "train/step_schedule.h"
#include "train/training_choice.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

Image random_image(int width, int height, std::uint64_t seed) {
  Image image;
  image.reshape(width, height, 3);
  Random random(seed, 0, RandomPurpose::kInitial);
  for (float& v : image.data) v = random.uniform();
  return image;
}

}  // namespace

TEST_CASE(
    "the first Adam step has the length of the rate, whatever the magnitude of the gradient") {
  for (const float gradient : {1e-6f, 3.0f, -250.0f}) {
    float value = 1.0f, first = 0.0f, second = 0.0f;
    adam_step(&value, &first, &second, &gradient, 1, 0.01f, AdamCorrection(1));
    CHECK(value == Approx(1.0f - std::copysign(0.01f, gradient)).epsilon(1e-4));
  }
}

TEST_CASE("Adam follows its definition over many steps") {
  float value = 0.5f, first = 0.0f, second = 0.0f;
  double v = 0.5, m = 0, s = 0;
  for (std::uint32_t n = 1; n <= 50; ++n) {
    const float gradient = std::sin(0.7f * static_cast<float>(n)) + value;
    adam_step(&value, &first, &second, &gradient, 1, 0.02f, AdamCorrection(n));
    m = 0.9 * m + 0.1 * gradient;
    s = 0.999 * s + 0.001 * gradient * gradient;
    v -= 0.02 * (m / (1 - std::pow(0.9, n))) / (std::sqrt(s / (1 - std::pow(0.999, n))));
    CHECK(value == Approx(v).epsilon(1e-4));
  }
}

TEST_CASE("gradients of the colour correction match finite differences") {
  const Image colour = random_image(37, 21, 1);
  const Image weights = random_image(37, 21, 2);
  ColourMap map = {1.1f,   0.05f, -0.02f, 0.03f, 0.9f,   0.01f,
                   -0.04f, 0.02f, 1.05f,  0.01f, -0.02f, 0.03f};
  Image corrected;
  const auto loss = [&](const ColourMap& m, const Image& c) {
    apply_colour(m, c, corrected);
    double sum = 0;
    for (std::size_t i = 0; i < corrected.data.size(); ++i) {
      sum += 0.5 * weights.data[i] * corrected.data[i] * corrected.data[i];
    }
    return sum;
  };
  loss(map, colour);
  Image d_corrected = corrected;
  for (std::size_t i = 0; i < d_corrected.data.size(); ++i) d_corrected.data[i] *= weights.data[i];
  const ColourMap gradient = colour_backward(map, colour, d_corrected);
  const float step = 1e-2f;  // the loss is quadratic: central differences are exact
  for (std::size_t i = 0; i < map.size(); ++i) {
    ColourMap high = map, low = map;
    high[i] += step;
    low[i] -= step;
    CHECK(gradient[i] ==
          Approx((loss(high, colour) - loss(low, colour)) / (2 * step)).epsilon(1e-3));
  }
  for (const std::size_t i : {std::size_t{5}, std::size_t{900}, colour.data.size() - 1}) {
    Image high = colour, low = colour;
    high.data[i] += step;
    low.data[i] -= step;
    CHECK(d_corrected.data[i] ==
          Approx((loss(map, high) - loss(map, low)) / (2 * step)).epsilon(1e-2));
  }
}

TEST_CASE("update_colour keeps the mean of all colour maps at the identity") {
  TrainState state = random_train_state(1, 3);
  const ColourMap gradient = {1, -2, 3, 0.1f, 5, -6, 7, 8, -9, 1, 1, -1};
  for (int i = 0; i < 5; ++i) update_colour(state, i % 2, gradient, 0.01f);
  for (std::size_t k = 0; k < kIdentityColour.size(); ++k) {
    CHECK(0.5f * (state.colour[0][k] + state.colour[1][k]) ==
          Approx(kIdentityColour[k]).margin(1e-6));
  }
  CHECK(state.colour[0] != kIdentityColour);
}

TEST_CASE("gradients of the regularisers match finite differences of their loss") {
  const std::size_t n = 6;
  TrainState state = random_train_state(n, 4);
  SplatFrame frame;
  frame.splats.resize(n);
  for (std::size_t i = 0; i < n; ++i) frame.splats[i].id = static_cast<std::uint32_t>(i);
  StepInput input;
  input.ticks = 0.4f;
  input.weight_lifespan = 0.7f;
  input.weight_opacity = 0.5f;
  input.weight_scale = 0.3f;
  input.second_stage = true;
  const auto difference = [&](float& value) {
    const float before = value, step = 1e-2f;
    value = before + step;
    const double high = cpu::regularisation_loss(state.set, state.updates, frame, input);
    value = before - step;
    const double low = cpu::regularisation_loss(state.set, state.updates, frame, input);
    value = before;
    return (high - low) / (2 * step);
  };
  for (std::size_t i = 0; i < n; ++i) {
    float d_scale[3] = {}, d_logit = 0, d_sigma = 0, d_radius = 0;
    cpu::regularise(state.set, n, i, input, d_scale, d_logit, d_sigma, d_radius);
    CHECK(d_logit == Approx(difference(state.set.opacity_logit[i])).epsilon(1e-2).margin(1e-5));
    for (int c = 0; c < 3; ++c) {
      CHECK(d_scale[c] ==
            Approx(difference(state.set.log_scale[3 * i + c])).epsilon(1e-2).margin(1e-5));
    }
    // sigma and radius also change l(t), which the paper holds constant, so leave L_opacity out.
    input.second_stage = false;
    CHECK(d_sigma == Approx(difference(state.set.sigma[i])).epsilon(2e-2).margin(1e-4));
    CHECK(d_radius == Approx(difference(state.set.radius[i])).epsilon(2e-2).margin(1e-4));
    input.second_stage = true;
  }
}

TEST_CASE("a change of the lifespan preserves the motion") {
  TrainState state = random_train_state(4, 6);
  state.derive_all(true);
  const FloatArray before = state.set.velocity;
  for (std::size_t i = 0; i < state.size(); ++i) {
    const float f = math::lifespan_modulation(state.set.sigma[i], state.set.radius[i]);
    state.log_sigma[i] += 1.5f;
    state.set.radius[i] += 2.0f;
    state.damp(i, f, true, {0.0f, 0.0f, 0.0f});
    state.derive(i, true);
    CHECK(state.set.sigma[i] == Approx(std::exp(state.log_sigma[i])));
  }
  for (std::size_t k = 0; k < before.size(); ++k) {
    CHECK(state.set.velocity[k] == Approx(before[k]).epsilon(1e-5));
  }
}

TEST_CASE(
    "long-lived primitives are damped in each step until they are static, short-lived ones are "
    "not") {
  const math::DampingRules rules{25.0f, 0.5f, 0.0f};
  const math::Vec3 v{0.0f, 1.5f, -2.0f};  // length 2.5
  const math::Vec3 short_lived = math::damped_velocity(v, 2.0f, 10.0f, 0.0f, rules);
  CHECK(short_lived.y == Approx(3.0f));
  CHECK(short_lived.z == Approx(-4.0f));
  const math::Vec3 damped = math::damped_velocity(v, 1.0f, 11.0f, 0.0f, rules);
  CHECK(damped.x == 0.0f);
  CHECK(damped.y == Approx(1.2f));
  CHECK(damped.z == Approx(-1.6f));
  const math::Vec3 static_velocity =
      math::damped_velocity({0.3f, 0.0f, 0.4f}, 1.0f, 11.0f, 0.0f, rules);
  CHECK(math::dot3(static_velocity, static_velocity) == 0.0f);
  // A flat top of 20 ticks with steep sides ends while a sigma of 20 would still be visible.
  const math::Vec3 flat_top = math::damped_velocity(v, 1.0f, 1.0f, 20.0f, rules);
  CHECK(flat_top.y == Approx(1.5f));
  CHECK(math::damped_velocity(v, 1.0f, 3.0f, 20.0f, rules).y == Approx(1.2f));
}

TEST_CASE("a fast primitive that becomes long-lived is static after a few hundred steps") {
  const math::DampingRules rules{19.0f, 5e-4f, 0.0625f};
  math::Vec3 v{0.0f, 110.0f, 0.0f};  // 0.2 units per frame at a sigma of 23 frames
  for (int step = 0; step < 300; ++step) v = math::damped_velocity(v, 1.0f, 23.0f, 0.0f, rules);
  CHECK(v.y == 0.0f);
  const math::Vec3 undamped =
      math::damped_velocity({0, 110.0f, 0}, 1.0f, 23.0f, 0.0f, {19.0f, 0.0f, 0.0625f});
  CHECK(undamped.y == 110.0f);
}

TEST_CASE("without modulation v is the motion, and is damped by the lifespan as well") {
  TrainState state = random_train_state(2, 6);
  state.log_sigma = {std::log(3.0f), std::log(40.0f)};
  state.set.radius = {0.0f, 0.0f};
  state.velocity = {0.3f, 0.0f, 0.4f, 0.3f, 0.0f, 0.4f};
  const math::DampingRules rules{50.0f, 0.25f, 0.0f};
  for (std::size_t i = 0; i < 2; ++i) {
    state.damp(i, 7.0f, false, rules);
    state.derive(i, false);
  }
  CHECK(state.set.velocity == FloatArray{0.3f, 0.0f, 0.4f, 0.15f, 0.0f, 0.2f});
}

TEST_CASE("each step drops its share of the primitives, another selection each time") {
  constexpr std::uint32_t kMany = 20000;
  const Random first(1, 5, RandomPurpose::kDrop), second(1, 6, RandomPurpose::kDrop);
  int dropped_once = 0, dropped_twice = 0;
  for (std::uint32_t i = 0; i < kMany; ++i) {
    CHECK_FALSE(dropped(first, 0.0f, i));
    dropped_once += dropped(first, 0.1f, i);
    dropped_twice += dropped(first, 0.1f, i) && dropped(second, 0.1f, i);
  }
  CHECK(dropped_once == Approx(0.1 * kMany).epsilon(0.1));
  CHECK(dropped_twice == Approx(0.01 * kMany).epsilon(0.3));
}

TEST_CASE("cached files of a control group count as free memory, its shared memory does not") {
  const testing::TemporaryFolder folder;
  const std::filesystem::path root = folder.path;
  const auto group = [&](const std::filesystem::path& name, const char* limit, int current,
                         const char* statistics) {
    std::filesystem::create_directories(root / name);
    std::ofstream(root / name / "memory.max") << limit << '\n';
    std::ofstream(root / name / "memory.current") << current << '\n';
    std::ofstream(root / name / "memory.stat") << statistics;
  };
  group("job", "1000", 700, "anon 300\nfile 400\nshmem 150\n");
  CHECK(cgroup_available_memory(root, "job") == 550);
  group("job", "1000", 700, "anon 300\nfile 400\n");
  CHECK(cgroup_available_memory(root, "job") == 700);
  group("job/step", "max", 600, "file 400\nshmem 0\n");
  CHECK(cgroup_available_memory(root, "job/step") == 700);
  group("job/step", "100", 200, "file 50\nshmem 90\n");
  CHECK(cgroup_available_memory(root, "job/step") == 0);
  CHECK(cgroup_available_memory(root, "elsewhere") == ~std::uint64_t{0});
}

TEST_CASE("a hyper-parameter out of range is reported with its value and its limits") {
  HyperParameters parameters;
  CHECK(check_hyper_parameters(parameters).ok());
  REQUIRE(set_hyper_parameter(parameters, "iterations", "0").ok());
  CHECK(check_hyper_parameters(parameters).message() ==
        "hyper-parameter iterations is out of range (expected 1 to 100000000, got 0)");
  for (const auto& [name, value] :
       std::initializer_list<std::pair<const char*, const char*>>{{"initial_opacity", "1"},
                                                                  {"drop_share", "10"},
                                                                  {"sigma_static", "0"},
                                                                  {"lr_position_final", "0"},
                                                                  {"stage1_until", "2"},
                                                                  {"weight_scale", "2000000000"}}) {
    parameters = {};
    REQUIRE(set_hyper_parameter(parameters, name, value).ok());
    const std::string message = check_hyper_parameters(parameters).message();
    CHECK(message.find(fmt::format("{} is out of range", name)) != std::string::npos);
    CHECK(message.find(fmt::format("got {}", value)) != std::string::npos);
  }
}

TEST_CASE("rates of 0 and stages of zero length give finite settings") {
  HyperParameters parameters;
  for (const char* name : {"lr_position", "lr_velocity", "stage1_until", "sh_step"}) {
    REQUIRE(set_hyper_parameter(parameters, name, "0").ok());
  }
  REQUIRE(check_hyper_parameters(parameters).ok());
  PreparedCapture capture;
  capture.extent = 2.0f;
  capture.scene_radius = 2.0f;
  capture.frames = 10;
  for (const double progress : {0.0, 0.5, 1.0}) {
    StepInput input;
    set_schedule(parameters, capture, progress, false, input);
    CHECK(input.rates[kPosition] == 0.0f);
    CHECK(input.rates[kVelocity] == 0.0f);
    CHECK(input.damping.shrink == 0.0f);
    CHECK(input.sh_degree == parameters.sh_degree);
    const DensifyPlan plan = densify_plan(parameters, {}, progress, true);
    CHECK(plan.second_stage);
    CHECK(plan.resets_due == 0);
  }
}

TEST_CASE("short clips do not damp the motion of dynamic content") {
  const HyperParameters parameters;
  PreparedCapture capture;
  for (const auto& [frames, visible_width] : {std::pair(4, 28.0), {40, 37.6}, {60, 56.4}}) {
    capture.frames = frames;
    StepInput input;
    set_schedule(parameters, capture, 0.5, false, input);
    CHECK(input.damping.half_width == Approx(visible_width / 2));
    CHECK(input.short_lived.half_clip == Approx(frames / 2.0));
    CHECK(input.short_lived.power == Approx(parameters.short_rate));
    const auto initial_sigma = static_cast<float>(parameters.sigma_dynamic);
    CHECK(input.damping.half_width >
          math::support_half_width(1.0f, initial_sigma, 0.0f, math::kAlphaThreshold));
  }
}

TEST_CASE("rates rise as lifespans become shorter than the clip, up to a limit") {
  const math::ShortLivedRules rules{30.0f, 0.5f};
  // Half of the support of a flat top is its radius.
  CHECK(math::short_lived_factor(1e-6f, 40.0f, rules) == 1.0f);
  CHECK(math::short_lived_factor(1e-6f, 30.0f / 4, rules) == Approx(2));
  CHECK(math::short_lived_factor(1e-6f, 0.1f, rules) == math::kMaxShortLivedFactor);
  const float half_width = math::support_half_width(1.0f, 3.0f, 1.0f, math::kAlphaThreshold);
  CHECK(math::short_lived_factor(3.0f, 1.0f, rules) == Approx(std::sqrt(30 / half_width)));
  CHECK(math::short_lived_factor(3.0f, 1.0f, {30.0f, 0.0f}) == 1.0f);
}

TEST_CASE("a step of a short-lived primitive is longer in all its parameters") {
  const auto lengths = [](float radius, float power) {
    TrainState state = random_train_state(1, 5);
    state.set.sigma[0] = 1e-3f;
    state.set.radius[0] = radius;
    const TrainState before = state;
    const std::vector<float> ones(3 * math::kShMaxCoefficients, 1.0f);
    cpu::LearntGradients gradients;
    gradients.by.fill(ones.data());
    gradients.coefficients = math::sh_coefficients(state.set.sh_degree);
    StepInput input;
    input.rates.fill(1e-4f);
    input.rate_sh0 = 1e-4f;
    input.short_lived = {20.0f, power};
    input.modulated = false;  // v is not rescaled
    cpu::adam_primitive(state, 0, gradients, input);
    std::vector<float> moved;
    for (int a = 0; a < kAttributes; ++a)
      for (std::size_t k = 0; k < state.values(a).size(); ++k)
        moved.push_back(state.values(a)[k] - before.values(a)[k]);
    return moved;
  };
  const std::vector<float> usual = lengths(5.0f, 0.0f), longer = lengths(5.0f, 0.5f);
  CHECK(lengths(25.0f, 0.5f) == lengths(25.0f, 0.0f));
  for (std::size_t k = 0; k < usual.size(); ++k)
    CHECK(longer[k] == Approx(2 * usual[k]).epsilon(0.02));
}

TEST_CASE("steps over several views update short-lived primitives more often") {
  HyperParameters parameters;
  parameters.batch_rate = 0;
  PreparedCapture capture;
  capture.frames = 60;
  const auto factor = [&](int views) {
    StepInput input;
    set_schedule(parameters, capture, 0.5, false, input);
    if (views > 1) set_batch_schedule(parameters, views, input);
    return math::short_lived_factor(1e-6f, 7.5f, input.short_lived);
  };
  CHECK(factor(1) == Approx(2));
  CHECK(factor(2) == Approx(std::sqrt(2)));
  CHECK(factor(8) == 1.0f);
}

TEST_CASE("a plan without cameras has images large enough for every loss term") {
  const TrainPlan plan = train_plan({}, {}, {});
  constexpr int kSsimWindow = 11;
  CHECK(plan.width >= kSsimWindow);
  CHECK(plan.height >= kSsimWindow);
}
