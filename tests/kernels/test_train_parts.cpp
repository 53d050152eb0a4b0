// SPDX-License-Identifier: Apache-2.0
// The trainer's parts against what they promise: Adam, colour correction, regularisers,
// densification, checkpoints.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "../api/temporary_folder.h"
#include "backend/cpu/regularisers.h"
#include "catch.h"
#include "stgs/format/math/blend.h"
#include "train/adam.h"
#include "train/checkpoint.h"
#include "train/colour_correction.h"
#include "train/densify.h"
#include "train/densify_plan.h"
#include "train/densify_rules.h"
#include "train/machine_memory.h"
#include "train/random.h"
#include "train/step_schedule.h"
#include "train/training_choice.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

TrainState random_state(std::size_t n, std::uint64_t seed) {
  TrainState state;
  state.set.sh_degree = 1;
  state.resize(n);
  Random random(seed, 0, RandomPurpose::kInitial);
  for (int a = 0; a < kAttributes; ++a) {
    for (float& v : state.values(a)) v = random.normal();
  }
  for (float& r : state.set.radius) r = std::abs(r);
  for (float& s : state.set.log_scale) s = 0.3f * s - 3.0f;
  state.derive_all(true);
  state.statistics.reset(n);
  state.colour.assign(2, kIdentityColour);
  state.colour_first.assign(2, ColourMap{});
  state.colour_second.assign(2, ColourMap{});
  state.colour_updates.assign(2, 0);
  return state;
}

Image random_image(int width, int height, std::uint64_t seed) {
  Image image;
  image.reshape(width, height, 3);
  Random random(seed, 0, RandomPurpose::kInitial);
  for (float& v : image.data) v = random.uniform();
  return image;
}

}  // namespace

TEST_CASE("the first Adam step has the length of its rate, whatever the gradient's size") {
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

TEST_CASE("the colour correction's gradients match finite differences") {
  const Image colour = random_image(37, 21, 1);
  const Image weights = random_image(37, 21, 2);
  ColourMap map = {1.1f,   0.05f, -0.02f, 0.03f, 0.9f,   0.01f,
                   -0.04f, 0.02f, 1.05f,  0.01f, -0.02f, 0.03f};
  Image shown;
  const auto loss = [&](const ColourMap& m, const Image& c) {
    apply_colour(m, c, shown);
    double sum = 0;
    for (std::size_t i = 0; i < shown.data.size(); ++i) {
      sum += 0.5 * weights.data[i] * shown.data[i] * shown.data[i];
    }
    return sum;
  };
  loss(map, colour);
  Image d_shown = shown;
  for (std::size_t i = 0; i < d_shown.data.size(); ++i) d_shown.data[i] *= weights.data[i];
  const ColourMap gradient = colour_backward(map, colour, d_shown);
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
    CHECK(d_shown.data[i] == Approx((loss(map, high) - loss(map, low)) / (2 * step)).epsilon(1e-2));
  }
}

TEST_CASE("updating colours keeps their mean at the identity") {
  TrainState state = random_state(1, 3);
  const ColourMap gradient = {1, -2, 3, 0.1f, 5, -6, 7, 8, -9, 1, 1, -1};
  for (int i = 0; i < 5; ++i) update_colour(state, i % 2, gradient, 0.01f);
  for (std::size_t k = 0; k < kIdentityColour.size(); ++k) {
    CHECK(0.5f * (state.colour[0][k] + state.colour[1][k]) ==
          Approx(kIdentityColour[k]).margin(1e-6));
  }
  CHECK(state.colour[0] != kIdentityColour);
}

TEST_CASE("the regularisers' gradients match finite differences of their loss") {
  const std::size_t n = 6;
  TrainState state = random_state(n, 4);
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
    const double high = cpu::regularisation_loss(state, frame, input);
    value = before - step;
    const double low = cpu::regularisation_loss(state, frame, input);
    value = before;
    return (high - low) / (2 * step);
  };
  for (std::size_t i = 0; i < n; ++i) {
    float d_scale[3] = {}, d_logit = 0, d_sigma = 0, d_radius = 0;
    cpu::regularise(state, n, i, input, d_scale, d_logit, d_sigma, d_radius);
    CHECK(d_logit == Approx(difference(state.set.opacity_logit[i])).epsilon(1e-2).margin(1e-5));
    for (int c = 0; c < 3; ++c) {
      CHECK(d_scale[c] ==
            Approx(difference(state.set.log_scale[3 * i + c])).epsilon(1e-2).margin(1e-5));
    }
    // sigma and radius also move l(t), which the paper holds constant: leave L_opacity out.
    input.second_stage = false;
    CHECK(d_sigma == Approx(difference(state.set.sigma[i])).epsilon(2e-2).margin(1e-4));
    CHECK(d_radius == Approx(difference(state.set.radius[i])).epsilon(2e-2).margin(1e-4));
    input.second_stage = true;
  }
}

TEST_CASE("a lifespan that changes leaves the motion as it is") {
  TrainState state = random_state(4, 6);
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

TEST_CASE("what lives long loses speed with each step, down to rest; what lives short keeps it") {
  const math::DampingRules rules{25.0f, 0.5f, 0.0f};
  const math::Vec3 v{0.0f, 1.5f, -2.0f};  // 2.5 long
  const math::Vec3 brief = math::damped_velocity(v, 2.0f, 10.0f, 0.0f, rules);
  CHECK(brief.y == Approx(3.0f));
  CHECK(brief.z == Approx(-4.0f));
  const math::Vec3 slower = math::damped_velocity(v, 1.0f, 11.0f, 0.0f, rules);
  CHECK(slower.x == 0.0f);
  CHECK(slower.y == Approx(1.2f));
  CHECK(slower.z == Approx(-1.6f));
  const math::Vec3 still = math::damped_velocity({0.3f, 0.0f, 0.4f}, 1.0f, 11.0f, 0.0f, rules);
  CHECK(math::dot3(still, still) == 0.0f);
  // A flat top of 20 ticks with steep sides is gone where a sigma of 20 would still be seen.
  const math::Vec3 flat = math::damped_velocity(v, 1.0f, 1.0f, 20.0f, rules);
  CHECK(flat.y == Approx(1.5f));
  CHECK(math::damped_velocity(v, 1.0f, 3.0f, 20.0f, rules).y == Approx(1.2f));
}

TEST_CASE("what flew by and then came to live long is at rest after a few hundred steps") {
  const math::DampingRules rules{19.0f, 5e-4f, 0.0625f};
  math::Vec3 v{0.0f, 110.0f, 0.0f};  // .2 units a frame at a sigma of 23 frames
  for (int step = 0; step < 300; ++step) v = math::damped_velocity(v, 1.0f, 23.0f, 0.0f, rules);
  CHECK(v.y == 0.0f);
  const math::Vec3 kept =
      math::damped_velocity({0, 110.0f, 0}, 1.0f, 23.0f, 0.0f, {19.0f, 0.0f, 0.0625f});
  CHECK(kept.y == 110.0f);
}

TEST_CASE("without the modulation v is the motion, and settles by the lifespan all the same") {
  TrainState state = random_state(2, 6);
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

TEST_CASE("a step leaves out its share of the primitives, others each time") {
  constexpr std::uint32_t kMany = 20000;
  const Random first(1, 5, RandomPurpose::kDrop), second(1, 6, RandomPurpose::kDrop);
  int left_out = 0, by_both = 0;
  for (std::uint32_t i = 0; i < kMany; ++i) {
    CHECK_FALSE(dropped(first, 0.0f, i));
    left_out += dropped(first, 0.1f, i);
    by_both += dropped(first, 0.1f, i) && dropped(second, 0.1f, i);
  }
  CHECK(left_out == Approx(0.1 * kMany).epsilon(0.1));
  CHECK(by_both == Approx(0.01 * kMany).epsilon(0.3));
}

TEST_CASE("two clones let as much light through as the one they came from") {
  for (const float logit : {-4.0f, -1.0f, 0.0f, 2.0f, 6.0f}) {
    const float copy = math::opacity_of(cloned_logit(logit));
    CHECK((1 - copy) * (1 - copy) == Approx(1 - math::opacity_of(logit)).epsilon(1e-3));
  }
}

TEST_CASE("growth clones the small, splits the large, removes the transparent") {
  TrainState state = random_state(8, 5);
  HyperParameters parameters;
  parameters.max_primitives = 100;
  parameters.growth_limit = 1.0;
  DensifyContext context;
  context.extent = 1.0f;
  const float small = std::log(0.001f), large = std::log(0.1f);
  for (std::size_t i = 0; i < 8; ++i) {
    state.set.opacity_logit[i] = 0.0f;
    std::fill_n(state.set.log_scale.begin() + 3 * static_cast<int>(i), 3, i < 4 ? small : large);
    state.statistics.views[i] = 1;
  }
  state.set.opacity_logit[7] = -8.0f;
  state.statistics.gradient_sum[1] = 1.0f;      // small and pulled: clone
  state.statistics.gradient_sum[5] = 1.0f;      // large: the absolute gradient counts
  state.statistics.abs_gradient_sum[6] = 1.0f;  // large and torn: split
  const DensifyCounts counts = grow(state, parameters, context);
  CHECK(counts.cloned == 1);
  CHECK(counts.split == 1);
  CHECK(counts.removed == 1);
  REQUIRE(state.size() == 9);
  CHECK(math::opacity_of(state.set.opacity_logit[1]) == Approx(1 - std::sqrt(0.5f)));
  CHECK(state.set.log_scale[3 * 6] == Approx(large - std::log(1.6f)));
  CHECK(state.statistics.views[1] == 0);
}

TEST_CASE("plain growth goes by the mean gradient alone, and its clones are copies") {
  TrainState state = random_state(4, 5);
  for (float& logit : state.set.opacity_logit) logit = 0.0f;
  for (int c = 0; c < 3; ++c) {
    state.set.log_scale[c] = std::log(1e-4f);  // 0 is small
    state.set.log_scale[3 + c] = state.set.log_scale[6 + c] = std::log(0.05f);
    state.set.log_scale[9 + c] = std::log(1e-4f);
  }
  state.statistics.views = {10, 10, 10, 10};
  const HyperParameters parameters;
  const auto pulled = static_cast<float>(2 * parameters.clone_gradient * 10);
  state.statistics.gradient_sum = {pulled, pulled, 0.0f, 0.0f};
  state.statistics.abs_gradient_sum = {pulled, pulled, 100.0f, 100.0f};
  state.moments[kOpacity].first[0] = 0.5f;
  DensifyContext context;
  context.plain = true;
  const DensifyCounts counts = grow(state, parameters, context);
  CHECK(counts.cloned == 1);
  CHECK(counts.split == 1);  // 2, which is pulled both ways, is left
  REQUIRE(state.size() == 6);
  for (int c = 0; c < 3; ++c) CHECK(state.set.position[12 + c] == state.set.position[c]);
  CHECK(state.set.opacity_logit[0] == 0.0f);
  CHECK(state.set.opacity_logit[4] == 0.0f);
  CHECK(state.moments[kOpacity].first[0] == 0.5f);
  CHECK(state.moments[kOpacity].first[4] == 0.0f);
}

TEST_CASE("the plan densifies as the paper does, or as 3DGS does") {
  HyperParameters p;
  p.opacity_resets = 2;
  const Ablation full;
  Ablation plain;
  plain.densification = false;
  const auto at = [&](const Ablation& ablation, double share) {
    return densify_plan(p, ablation, share, true);
  };
  CHECK_FALSE(at(full, 0.02).grow);
  CHECK(at(full, 0.2).grow);
  CHECK(at(full, 0.2).resets_due == 1);
  CHECK(at(full, 0.34).second_stage);
  CHECK(at(full, 0.34).replace);
  CHECK_FALSE(at(full, 0.34).grow);
  CHECK_FALSE(at(full, 0.9).replace);
  CHECK_FALSE(at(full, 0.9).gather);
  CHECK_FALSE(densify_plan(p, full, 0.2, false).grow);
  CHECK(densify_plan(p, full, 0.2, false).gather);
  CHECK(at(plain, 0.45).grow);
  CHECK(at(plain, 0.45).resets_due == 4);
  for (const double share : {0.34, 0.5, 0.7, 0.99}) {
    CHECK_FALSE(at(plain, share).replace);
    CHECK(at(plain, share).second_stage);  // the losses stay as they are
    CHECK(at(plain, share).grow == (share < 0.5));
  }
  CHECK_FALSE(at(plain, 0.5).gather);
}

TEST_CASE("a primitive that is not a number any more does not cost the run") {
  HyperParameters parameters;
  parameters.replace_limit = 1.0;
  TrainState state = random_state(20, 11);
  std::fill(state.set.opacity_logit.begin(), state.set.opacity_logit.end(), 0.0f);
  TrainState refined = state;
  refined.set.position[3 * 4 + 1] = std::nanf("");
  CHECK(replace(refined, parameters, {}).non_finite == 1);
  CHECK(std::isfinite(refined.set.position[3 * 4 + 1]));
  state.velocity[3 * 7] = INFINITY;
  CHECK(grow(state, parameters, {}).non_finite == 1);
  CHECK(state.size() == 19);
  state.log_sigma[2] = std::nanf("");
  CHECK(remove_non_finite(state) == 1);
  CHECK(state.size() == 18);
}

TEST_CASE("growth stops at the limit and takes the most urgent") {
  TrainState state = random_state(10, 6);
  HyperParameters parameters;
  parameters.max_primitives = 12;
  parameters.growth_limit = 1.0;
  for (std::size_t i = 0; i < 10; ++i) {
    state.set.opacity_logit[i] = 0.0f;
    std::fill_n(state.set.log_scale.begin() + 3 * static_cast<int>(i), 3, std::log(1e-4f));
    state.statistics.views[i] = 1;
    state.statistics.gradient_sum[i] = 1.0f + static_cast<float>(i);
  }
  grow(state, parameters, {});
  REQUIRE(state.size() == 12);
  CHECK(math::opacity_of(state.set.opacity_logit[9]) < 0.4f);
  CHECK(math::opacity_of(state.set.opacity_logit[8]) < 0.4f);
  CHECK(math::opacity_of(state.set.opacity_logit[0]) == Approx(0.5f));
}

TEST_CASE("replacement keeps N and clones the highest scores") {
  TrainState state = random_state(50, 7);
  HyperParameters parameters;
  parameters.replace_limit = 1.0;
  for (std::size_t i = 0; i < 50; ++i) state.set.opacity_logit[i] = 0.0f;
  state.set.opacity_logit[3] = state.set.opacity_logit[4] = -9.0f;
  state.statistics.error_max[20] = 10.0f;
  state.statistics.error_max[30] = 10.0f;
  for (std::size_t i : {20, 30}) state.log_sigma[i] = std::log(0.5f);
  state.derive_all(true);
  const DensifyCounts counts = replace(state, parameters, {});
  CHECK(state.size() == 50);
  CHECK(counts.replaced == 2);
  CHECK(state.log_sigma[3] == Approx(std::log(0.5f)));
  CHECK(math::opacity_of(state.set.opacity_logit[20]) == Approx(1 - std::sqrt(0.5f)));
}

TEST_CASE("the score prefers short, fast primitives at equal error and opacity") {
  TrainState state = random_state(3, 8);
  std::fill(state.set.opacity_logit.begin(), state.set.opacity_logit.end(), 0.0f);
  std::fill(state.set.radius.begin(), state.set.radius.end(), 0.0f);
  std::fill(state.velocity.begin(), state.velocity.end(), 0.0f);
  state.log_sigma = {std::log(0.8f), std::log(0.8f), std::log(60.0f)};
  state.velocity[0] = 3.0f;
  state.derive_all(true);
  const std::vector<float> s = densification_scores(state, HyperParameters{}, true);
  CHECK(s[0] > s[1]);
  CHECK(s[1] > s[2]);
}

TEST_CASE("a checkpoint brings every number back, and refuses damage") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "run.ckpt";
  TrainState state = random_state(5, 9);
  state.iteration = 77;
  state.seconds = 1.5;
  state.moments[kSh].second[3] = 0.25f;
  state.colour[1][4] = 0.75f;
  const Fingerprint fingerprint = {{"seed", "3"}, {"camera \"left\"", "640x360"}};
  REQUIRE(write_checkpoint(path, state, fingerprint).ok());
  const Result<Checkpoint> back = read_checkpoint(path);
  REQUIRE(back.ok());
  CHECK(back->fingerprint == fingerprint);
  CHECK(back->state.iteration == 77);
  CHECK(back->state.set.sh == state.set.sh);
  CHECK(back->state.moments[kSh].second == state.moments[kSh].second);
  CHECK(back->state.colour == state.colour);

  std::ifstream in(path, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  for (std::size_t at = 0; at < bytes.size(); at += 41) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x10);
    std::ofstream(path, std::ios::binary) << damaged;
    CHECK(read_checkpoint(path).status().code() == StatusCode::kInvalidFile);
  }
  std::ofstream(path, std::ios::binary) << bytes.substr(0, bytes.size() / 2);
  CHECK(read_checkpoint(path).status().code() == StatusCode::kInvalidFile);
  std::remove(path.c_str());
}

TEST_CASE("a checkpoint of another layout is told from what is none") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "run.ckpt";
  REQUIRE(write_checkpoint(path, random_state(2, 9), {}).ok());
  std::ifstream in(path, std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  for (const char layout : {'2', '4'}) {
    bytes[7] = layout;
    std::ofstream(path, std::ios::binary) << bytes;
    const Status status = read_checkpoint(path).status();
    CHECK(status.code() == StatusCode::kUnsupported);
    CHECK(status.message().find("another version of stgs; resume with") != std::string::npos);
  }
  bytes[6] = 'Q';
  std::ofstream(path, std::ios::binary) << bytes;
  CHECK(read_checkpoint(path).status().code() == StatusCode::kInvalidFile);
  std::remove(path.c_str());
}

TEST_CASE("a control group's cached files are free memory, its shared memory is not") {
  const testing::TemporaryFolder folder;
  const std::filesystem::path root = folder.path;
  const auto group = [&](const std::filesystem::path& name, const char* most, int held,
                         const char* statistics) {
    std::filesystem::create_directories(root / name);
    std::ofstream(root / name / "memory.max") << most << '\n';
    std::ofstream(root / name / "memory.current") << held << '\n';
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

TEST_CASE("a capture with its cameras in another order, or one less, is another") {
  PreparedCapture capture;
  capture.cameras.resize(3);
  for (std::size_t i = 0; i < 3; ++i) capture.cameras[i].name = std::string(1, "abc"[i]);
  const Fingerprint all = fingerprint_of(capture);
  std::swap(capture.cameras[0], capture.cameras[2]);
  const std::string swapped = check_same_run("k", all, fingerprint_of(capture)).message();
  CHECK(swapped.find("camera a: number 1") != std::string::npos);
  capture.cameras[0].test = true;
  const std::string fewer = check_same_run("k", all, fingerprint_of(capture)).message();
  CHECK(fewer.find("training cameras: 3, now 2") != std::string::npos);
}

TEST_CASE("a capture whose pictures have been replaced is another") {
  PreparedCapture capture;
  const testing::TemporaryFolder folder;
  capture.folder = folder.path;
  capture.frames = 2;
  capture.cameras.resize(1);
  capture.cameras[0].name = std::string(1, 'a');
  for (int frame = 0; frame < 2; ++frame) {
    const std::filesystem::path path = capture.frame_path(capture.cameras[0], frame);
    std::filesystem::create_directories(path.parent_path());
    std::ofstream(path) << "picture " << frame;
  }
  const Fingerprint before = image_fingerprint(capture);
  CHECK(check_same_run("k", before, image_fingerprint(capture)).ok());
  std::ofstream(capture.frame_path(capture.cameras[0], 1)) << "another picture";
  CHECK(check_same_run("k", before, image_fingerprint(capture))
            .message()
            .find("images of camera a") != std::string::npos);
}

TEST_CASE("what differs between two runs is named, with both values") {
  const Fingerprint found = {
      {"seed", "1"}, {"iterations", "30"}, {"frames", "6"}, {"backend", "cuda"}};
  CHECK(check_same_run("a.ckpt", found, found).ok());
  // Part of it, and another backend.
  CHECK(check_same_run("a.ckpt", found, {{"iterations", "30"}, {"backend", "cpu"}}).ok());
  const Status other =
      check_same_run("a.ckpt", found, {{"seed", "2"}, {"iterations", "30"}, {"camera b", "4x3"}});
  CHECK(other.code() == StatusCode::kUsage);
  const std::string& message = other.message();
  CHECK(message.find("a.ckpt: ") == 0);
  CHECK(message.find("\n  seed: 1, now 2\n  camera b: missing, now 4x3") != std::string::npos);
  CHECK(message.find("iterations") == std::string::npos);
  Fingerprint many;
  for (int i = 0; i < 40; ++i) many.emplace_back(fmt::format("p{}", i), "0");
  CHECK(check_same_run("a", {}, many).message().find("and 28 more") != std::string::npos);
}

TEST_CASE("a hyper-parameter out of its limits is named, with its value and its limits") {
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

TEST_CASE("rates of 0 and stages of no length leave every setting a number") {
  HyperParameters parameters;
  for (const char* name : {"lr_position", "lr_velocity", "stage1_until", "sh_step"}) {
    REQUIRE(set_hyper_parameter(parameters, name, "0").ok());
  }
  REQUIRE(check_hyper_parameters(parameters).ok());
  PreparedCapture capture;
  capture.extent = 2.0f;
  capture.scene_radius = 2.0f;
  capture.frames = 10;
  for (const double share : {0.0, 0.5, 1.0}) {
    StepInput input;
    set_schedule(parameters, capture, share, false, input);
    CHECK(input.rates[kPosition] == 0.0f);
    CHECK(input.rates[kVelocity] == 0.0f);
    CHECK(input.damping.shrink == 0.0f);
    CHECK(input.sh_degree == parameters.sh_degree);
    const DensifyPlan plan = densify_plan(parameters, {}, share, true);
    CHECK(plan.second_stage);
    CHECK(plan.resets_due == 0);
  }
}

TEST_CASE("what moves is not brought to rest for filling a clip that is short") {
  const HyperParameters parameters;
  PreparedCapture capture;
  for (const auto& [frames, seen] : {std::pair(4, 28.0), {40, 37.6}, {60, 56.4}}) {
    capture.frames = frames;
    StepInput input;
    set_schedule(parameters, capture, 0.5, false, input);
    CHECK(input.damping.half_width == Approx(seen / 2));
    const auto first = static_cast<float>(parameters.sigma_dynamic);
    CHECK(input.damping.half_width >
          math::support_half_width(1.0f, first, 0.0f, math::kAlphaThreshold));
  }
}

TEST_CASE("a plan without cameras is for pictures that every term of the loss can take") {
  const TrainPlan plan = train_plan({}, {}, {});
  CHECK(plan.width >= kVggMinSize);
  CHECK(plan.height >= kVggMinSize);
}
