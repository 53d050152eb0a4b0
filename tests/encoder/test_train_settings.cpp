// SPDX-License-Identifier: Apache-2.0
// Every hyper-parameter has an effect on training, or setting it is rejected.
#include <algorithm>
#include <map>

#include "../kernels/thread_ranks.h"
#include "catch.h"
#include "fixtures/train_run.h"
#include "train/training_choice.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::SyntheticCapture;

namespace {

using Values = std::map<std::string, std::string>;

// A short run that exercises every component of the method.
const Values kBase = {{"iterations", "14"},
                      {"max_primitives", "80"},
                      {"sh_degree", "1"},
                      {"densify_interval", "1"},
                      {"stage1_until", "0.4"},
                      {"opacity_resets", "1"},
                      {"clone_gradient", "1e-5"},
                      {"split_gradient", "1e-5"},
                      {"split_scale", "0.18"},
                      {"prune_opacity", "0.45"},
                      {"replace_limit", "0.1"},
                      {"plain_reset", "0.35"},
                      {"drop_share", "0.1"},
                      {"weight_normal", "0.2"},
                      {"sigma_dynamic", "0.2"},
                      {"still_least", "0.5"},
                      {"sigma_static", "0.145"},
                      {"lr_sigma", "0.05"},
                      {"compact_share", "0"},
                      {"initial_opacity_dynamic", "0.5"},
                      {"initial_scale_dynamic", "0.8"}};

// Parameters for which 1.7 times the base value is invalid or has no visible effect.
const Values kOther = {{"iterations", "15"},
                       {"max_primitives", "70"},
                       {"sh_degree", "2"},
                       {"compact_quality", "60"},
                       {"compact_rounds", "1"},
                       {"compact_moving", "2"},
                       {"compact_rate", "0.01"},
                       {"compact_restart", "0.1"},
                       {"compact_keep", "0.5"},
                       {"compact_share", "0.2"},
                       {"lr_position_final", "1e-3"},
                       {"lr_sh_rest", "0.05"},
                       {"densify_interval", "2"},
                       {"opacity_resets", "4"},
                       {"seen_background", "0"},
                       {"kernel", "0"},
                       {"min_scale", "4"},
                       {"velocity_times_f", "0"},
                       {"initial_radius", "1"},
                       {"initial_scale", "0.2"},
                       {"densify_until", "0.6"},
                       {"prune_opacity", "0.3"},
                       {"plain_prune", "0.4"},
                       {"prune_scale", "0.1"},
                       {"clone_gradient", "1"},
                       {"split_gradient", "1"},
                       {"still_from", "0.3"},
                       {"split_scale", "0.1"},
                       {"sh_step", "0.6"},
                       {"score_error", "0.01"},
                       {"score_opacity", "50"},
                       {"score_lifespan", "50"},
                       {"plain_reset", "0.45"},
                       {"still_least", "10"},
                       {"densify_from", "0.2"},
                       {"perceptual_from", "0.5"},
                       {"perceptual_patch", "32"},
                       {"velocity_share", "1"}};

// The same for the published methods.
const Values kOfMethods = {
    {"kernel", "1"}, {"densify_from", "0.8"}, {"velocity_shrink", "1000"}, {"still_from", "2"}};

bool is_method(const std::string& variant) {
  const std::vector<std::string> methods = method_names();
  return std::find(methods.begin(), methods.end(), variant) != methods.end();
}

// Returns the settings of a variant: the name of a method or of ablations.
TrainSettings settings_of(const std::string& variant, const Values& values) {
  TrainSettings settings;
  settings.preset = "fast";
  settings.backend = "cpu";
  settings.held_out_evaluations = 0;
  (is_method(variant) ? settings.method : settings.ablate) = variant;
  settings.overrides.assign(values.begin(), values.end());
  return settings;
}

bool is_rejected(const TrainSettings& settings) {
  const Status status = choose_training(settings).status();
  if (status.ok()) return false;
  CAPTURE(status.message());
  REQUIRE(status.message().find(" has no effect ") != std::string::npos);
  return true;
}

// The base without the parameters that the variant does not use.
Values base_of(const std::string& variant) {
  Values base = kBase;
  if (variant == "initialisation") {  // few points, all of the largest initial size
    base["split_scale"] = "0.1875";
    base["clone_gradient"] = "3e-6";
  }
  std::erase_if(base,
                [&](const auto& value) { return is_rejected(settings_of(variant, {value})); });
  if (variant == "freetimegs") {  // with damping, which it lacks
    base["velocity_shrink"] = "0.5";
    base["still_least"] = "0.5";
    base["sigma_static"] = "0.3";
  }
  return base;
}

std::string other_value(const std::string& name, const std::string& value) {
  const auto entry = kOther.find(name);
  return entry != kOther.end() ? entry->second : fmt::format("{}", 1.7 * std::stod(value));
}

bool same_scene(const Scene& a, const Scene& b) {
  return test::same(a.gaussians, b.gaussians) &&
         std::equal(a.metadata.background, a.metadata.background + 3, b.metadata.background);
}

}  // namespace

TEST_CASE("the learning rate of refined timing changes the scene; one camera is too few") {
  const SyntheticCapture synthetic(3, 4);
  TrainSettings settings = test::short_run(60);
  settings.refine_timing = true;
  const Result<Scene> base = test::run(synthetic, settings);
  settings.overrides.emplace_back("lr_timing", "0.01");
  const Result<Scene> changed = test::run(synthetic, settings);
  REQUIRE(base.ok());
  REQUIRE(changed.ok());
  CHECK_FALSE(same_scene(*base, *changed));
  SyntheticCapture few(3, 4);
  few.capture.cameras[1].test = true;
  const Status status = test::run(few, settings).status();
  CHECK(status.code() == StatusCode::kUsage);
  CHECK(status.message().find("at least 2 training cameras") != std::string::npos);
}

TEST_CASE("the hyper-parameters of refined cameras change the scene; two cameras are too few") {
  const SyntheticCapture synthetic(4, 4);
  TrainSettings settings = test::short_run(60);
  settings.refine_cameras = true;
  const Result<Scene> base = test::run(synthetic, settings);
  REQUIRE(base.ok());
  for (const auto& [name, value] : Values{{"lr_camera", "1e-3"}, {"camera_pull", "0.2"}}) {
    TrainSettings changed = settings;
    changed.overrides.emplace_back(name, value);
    const Result<Scene> scene = test::run(synthetic, changed);
    CAPTURE(name);
    REQUIRE(scene.ok());
    CHECK_FALSE(same_scene(*base, *scene));
  }
  const SyntheticCapture few(3, 4);
  const Status status = test::run(few, settings).status();
  CHECK(status.code() == StatusCode::kUsage);
  CHECK(status.message().find("at least 3 training cameras") != std::string::npos);
}

TEST_CASE("every hyper-parameter changes the scene or is rejected, for every method and ablation") {
  const SyntheticCapture synthetic(3, 4);
  std::vector<std::string> variants = ablation_names();
  variants.insert(variants.end(), {"", "freetimegs", "4dgs"});
  std::map<std::string, std::vector<std::string>> left_out;
  for (const std::string& variant : variants) {
    // Rounding hides small differences, so only its own parameters are tested with it.
    Values plain = base_of(variant), compacted = plain;
    if (variant != "representation" && variant != "4dgs") {
      compacted["compact_share"] = "0.5";
      compacted["compact_quality"] = "100";
      compacted["iterations"] = "30";
      compacted["lr_sh_rest"] = "0.05";
      if (variant != "initialisation") compacted.erase("sigma_static");
    }
    const Result<Scene> before_plain = test::run(synthetic, settings_of(variant, plain));
    const Result<Scene> before_compacted = test::run(synthetic, settings_of(variant, compacted));
    INFO(before_plain.status().message());
    REQUIRE(before_plain.ok());
    REQUIRE(before_compacted.ok());
    for (const auto& [parameter, value] : hyper_parameters("fast")) {
      const std::string name = parameter.name;
      const bool compacts = name.find("compact_") == 0;
      const Values& base = compacts ? compacted : plain;
      const Result<Scene>& before = compacts ? before_compacted : before_plain;
      Values changed = base;
      const auto entry = base.find(name);
      changed[name] = other_value(name, entry == base.end() ? value : entry->second);
      const auto exception = kOfMethods.find(name);
      if (is_method(variant) && exception != kOfMethods.end()) changed[name] = exception->second;
      const TrainSettings settings = settings_of(variant, changed);
      if (is_rejected(settings)) {
        left_out[variant].push_back(name);
        continue;
      }
      const Result<Scene> after = test::run(synthetic, settings);
      CAPTURE(variant, name, changed[name], after.status().message());
      REQUIRE(after.ok());
      CHECK_FALSE(same_scene(*before, *after));
    }
  }
  // Only these are rejected.
  CHECK(left_out[""] == std::vector<std::string>{"weight_perceptual", "lr_camera", "camera_pull",
                                                 "lr_timing", "batch_rate", "batch_memory",
                                                 "plain_until", "plain_prune", "plain_reset",
                                                 "perceptual_from", "perceptual_patch"});
  CHECK(left_out["modulation"].size() == left_out[""].size() + 1);
}

TEST_CASE("large scenes retain fainter primitives, unless prune_opacity is set") {
  const auto pruned = [](const char* preset, int primitives, const Values& values) {
    TrainSettings settings = settings_of("", values);
    settings.preset = preset;
    settings.max_primitives = primitives;
    const Result<TrainingChoice> choice = choose_training(settings);
    REQUIRE(choice.ok());
    return choice->parameters.prune_opacity;
  };
  CHECK(pruned("default", 0, {}) == 0.02);
  CHECK(pruned("default", 200000, {}) == 0.02);
  CHECK(pruned("default", 200001, {}) == 0.005);
  CHECK(pruned("default", 400000, {{"prune_opacity", "0.01"}}) == 0.01);
  CHECK(pruned("best", 400000, {}) == 0.005);
}

TEST_CASE("parameters of the compaction that a target replaces are rejected") {
  const auto rejected = [](const char* name, const char* value, auto change) {
    TrainSettings settings = settings_of("", {{name, value}});
    change(settings);
    return is_rejected(settings);
  };
  const auto none = [](TrainSettings&) {};
  const auto size = [](TrainSettings& s) { s.target_size = 1e6; };
  const auto psnr = [](TrainSettings& s) { s.target_psnr = 30; };
  const auto quality = [](TrainSettings& s) { s.quality = 60; };
  CHECK_FALSE(rejected("compact_keep", "0.3", none));
  CHECK(rejected("compact_keep", "0.3", size));
  CHECK(rejected("compact_keep", "0.3", psnr));
  CHECK_FALSE(rejected("compact_rounds", "3", size));
  CHECK(rejected("compact_rounds", "3", psnr));
  CHECK(rejected("compact_quality", "50", quality));
}

TEST_CASE("the best preset densifies on half-size images only") {
  TrainSettings settings;
  settings.preset = "best";
  const Result<TrainingChoice> choice = choose_training(settings);
  REQUIRE(choice.ok());
  CHECK(choice->parameters.coarse_until > choice->parameters.stage1_until);
}

TEST_CASE("short runs densify as often as one of 750 iterations, unless the interval is set") {
  const auto interval = [](int iterations, const Values& values) {
    TrainSettings settings = settings_of("", values);
    settings.iterations = iterations;
    const Result<TrainingChoice> choice = choose_training(settings);
    REQUIRE(choice.ok());
    return choice->parameters.densify_interval;
  };
  CHECK(interval(1, {}) == 1);
  CHECK(interval(290, {}) == 39);
  CHECK(interval(749, {}) == 100);
  CHECK(interval(750, {}) == 100);
  CHECK(interval(30000, {}) == 100);
  CHECK(interval(290, {{"densify_interval", "100"}}) == 100);

  const SyntheticCapture synthetic(4, 2);
  const Values growing = {
      {"split_gradient", "1e-9"}, {"clone_gradient", "1e-9"}, {"compact_keep", "1"}};
  TrainSettings settings = settings_of("", growing);
  settings.iterations = 40;
  settings.max_primitives = 600;
  const Result<Scene> grown = test::run(synthetic, settings);
  REQUIRE(grown.ok());
  CHECK(grown->gaussians.size() > 220 + 2 * 12);  // more than the initial points
}

TEST_CASE("a run with a time limit and slow steps densifies by elapsed time") {
  const SyntheticCapture synthetic(4, 2);
  TrainSettings settings = settings_of("", {{"densify_interval", "1000000"}});
  settings.iterations = 1000000;
  settings.max_seconds = 1;
  int densifications = 0;
  const auto log = [&](int, const std::string& line) {
    if (line.find(" cloned, ") != std::string::npos) ++densifications;
  };
  REQUIRE(train(synthetic.capture, settings, nullptr, log, nullptr).ok());
  CHECK(densifications >= 1);
  CHECK(densifications <= 5);
}

TEST_CASE("a parameter is rejected only if its weights, ranks or enabling parameter are missing") {
  const auto rejects = [](const Values& values, const char* weights, Ranks* ranks) {
    TrainSettings settings = settings_of("", values);
    settings.perceptual_weights = weights;
    settings.ranks = ranks;
    return is_rejected(settings);
  };
  CHECK(rejects({{"perceptual_patch", "32"}}, "", nullptr));
  CHECK_FALSE(rejects({{"perceptual_patch", "32"}}, "vgg.safetensors", nullptr));
  CHECK(rejects({{"perceptual_patch", "32"}, {"weight_perceptual", "0"}}, "vgg.safetensors",
                nullptr));
  CHECK(rejects({{"weight_perceptual", "0"}}, "vgg.safetensors", nullptr));
  CHECK(rejects({{"score_error", "3"}, {"replace_limit", "0"}}, "", nullptr));
  CHECK(rejects({{"normal_from", "0.1"}, {"weight_normal", "0"}}, "", nullptr));
  CHECK_FALSE(rejects({{"normal_from", "0.1"}}, "", nullptr));
  for (const char* name :
       {"lr_velocity_final", "still_from", "velocity_share", "velocity_shrink"}) {
    CHECK(rejects({{name, "0.2"}, {"lr_velocity", "0"}}, "", nullptr));
    CHECK_FALSE(rejects({{name, "0.2"}, {"lr_velocity", "0.1"}}, "", nullptr));
  }
  CHECK(rejects({{"lr_position_final", "0.2"}, {"lr_position", "0"}}, "", nullptr));
  CHECK(rejects({{"sh_step", "0.2"}, {"sh_degree", "0"}}, "", nullptr));
  stgs::testing::SharedState shared(2);
  stgs::testing::ThreadRanks two(shared, 0);
  CHECK_FALSE(rejects({{"batch_rate", "0.2"}}, "", &two));
  CHECK(rejects({{"batch_rate", "0.2"}}, "", nullptr));
}
