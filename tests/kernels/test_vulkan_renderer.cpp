// SPDX-License-Identifier: Apache-2.0
// The Vulkan renderer in the renderer_*_cases.cpp, with the validation layer if it is installed.
// Its variant uses shared memory instead of ballots, and small blocks of segments. Exit code 77: no
// device found, no validation layer although STGS_VALIDATED is set, or Mesa's CPU device lacks the
// subgroups of STGS_CPU_SUBGROUP lanes.
#define CATCH_CONFIG_EXTERNAL_INTERFACES
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include "catch.h"
#include "catch_runner.h"
#include "fixtures/scene_fixture.h"
#include "renderer_under_test.h"
#include "vulkan/vulkan_renderer.h"
#include "vulkan_compute.h"
#include "vulkan_host/instance.h"

namespace stgs::testing {
namespace {

// Messages of the validation layer from all renderers.
std::vector<std::string>& messages() {
  static std::vector<std::string> all;
  return all;
}

// The instance of all renderers, which is never destroyed. Null without a Vulkan loader.
VkInstance validated_instance() {
  static const std::function<void(const std::string&)> add = [](const std::string& message) {
    messages().push_back(message);
  };
  static const tools::Instance shared = [] {
    tools::Instance made;
    if (volkInitialize() != VK_SUCCESS) return made;
    tools::InstanceSettings settings;
    settings.on_message = &add;
    (void)tools::make_instance(settings, made);
    return made;
  }();
  return shared.handle;
}

player::VulkanSettings settings_of(const UnderTest& under_test) {
  player::VulkanSettings settings;
  settings.initial_instances = under_test.instances;
  settings.use_ballot = !under_test.variant;
  if (under_test.variant) settings.block_bytes = 150'000;
  settings.instance = validated_instance();
  return settings;
}

}  // namespace

Result<std::unique_ptr<player::Renderer>> make_renderer_under_test(const UnderTest& settings) {
  return player::make_vulkan_renderer(settings_of(settings));
}

TEST_CASE("after a frame that does not fit into memory, others render as before") {
  player::VulkanSettings settings = settings_of({});
  settings.range_bytes = 500'000;
  auto renderer = player::make_vulkan_renderer(settings);
  REQUIRE(renderer.ok());
  Scene scene = random_scene(10'000, 0, 60, 77);
  std::fill(scene.gaussians.sigma.begin(), scene.gaussians.sigma.end(), 1000.0f);
  auto bytes = encode_scene(scene, WriteSettings{});
  REQUIRE(bytes.ok());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  REQUIRE(reader.ok());
  const auto timeline = player::Timeline::from_reader(std::move(*reader), "the scene");
  player::View view{};
  view.camera =
      math::PinholeCamera{{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 3}, 90, 90, 50, 40, 100, 80, 0.1f};
  std::vector<player::Frame> before, after;
  REQUIRE((*renderer)->render(*timeline, 1.0, {view}, before, nullptr).ok());
  const std::vector<player::View> many(player::kMaxViews, view);
  for (int k = 0; k < 2; ++k) {
    const Status rejected = (*renderer)->draw(*timeline, 1.0, many, nullptr);
    INFO(rejected.message());
    CHECK(rejected.code() == StatusCode::kUnsupported);
  }
  REQUIRE((*renderer)->render(*timeline, 1.0, {view}, after, nullptr).ok());
  CHECK(before[0].colour.data == after[0].colour.data);
}

// Prints the messages of the validation layer at the end of the run; any message fails the program.
class Listener : public Catch::TestEventListenerBase {
 public:
  using Catch::TestEventListenerBase::TestEventListenerBase;
  void testRunEnded(const Catch::TestRunStats&) override {
    for (const std::string& message : messages()) std::printf("%s\n", message.c_str());
  }
};
CATCH_REGISTER_LISTENER(Listener)

// Prints the device under test. Returns why it is not the requested one, or an empty string.
std::string skip_reason() {
  const test::VulkanCompute vulkan;
  if (!vulkan.missing().empty()) return vulkan.missing();
  const std::uint32_t lanes = vulkan.subgroup_size(0);
  std::printf("%s, subgroups of %u, %s\n", vulkan.devices()[0].c_str(), lanes,
              vulkan.validated() ? "validated" : "without the validation layer");
  if (std::getenv("STGS_VALIDATED") != nullptr && !vulkan.validated()) {
    return "the validation layer is not installed";
  }
  const char* const target = std::getenv("STGS_CPU_SUBGROUP");
  const bool checked = target != nullptr && vulkan.devices()[0].starts_with("llvmpipe");
  if (!checked || std::to_string(lanes) == target) return {};
  return std::string("the subgroups do not have ") + target + " lanes";
}

}  // namespace stgs::testing

int main(int argc, char** argv) {
  using namespace stgs;
  if (const std::string reason = testing::skip_reason(); !reason.empty()) {
    std::printf("skipped: %s\n", reason.c_str());
    return 77;
  }
  const auto renderer = testing::make_renderer_under_test({});
  if (renderer.status().code() == StatusCode::kUnsupported) {
    std::printf("skipped: %s\n", renderer.status().message().c_str());
    return 77;
  }
  const int failed = stgs::testing::run_cases(argc, argv);
  return failed != 0 ? failed : static_cast<int>(!testing::messages().empty());
}
