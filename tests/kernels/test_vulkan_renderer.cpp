// SPDX-License-Identifier: Apache-2.0
// The Vulkan renderer through renderer_cases.cpp, with the validation layer where it is installed;
// its variant keeps to shared memory and to small blocks of segments. Exit code 77: there is no
// device.
#define CATCH_CONFIG_RUNNER
#include <catch2/catch.hpp>
#include <cstdio>
#include <string>
#include <vector>

#include "renderer_under_test.h"
#include "vulkan/vulkan_renderer.h"

namespace stgs::testing {
namespace {

// Of the layer, from all renderers.
std::vector<std::string>& messages() {
  static std::vector<std::string> all;
  return all;
}

player::VulkanSettings settings_of(const UnderTest& under_test) {
  player::VulkanSettings settings;
  settings.instances = under_test.instances;
  settings.ballot = !under_test.variant;
  if (under_test.variant) settings.block_bytes = 150'000;
  settings.on_message = [](const std::string& message) { messages().push_back(message); };
  return settings;
}

}  // namespace

Result<std::unique_ptr<player::Renderer>> make_renderer_under_test(const UnderTest& settings) {
  return player::make_vulkan_renderer(settings_of(settings));
}

// Fails each case whose commands the layer has something to say about.
class Listener : public Catch::TestEventListenerBase {
 public:
  using TestEventListenerBase::TestEventListenerBase;
  void testRunEnded(const Catch::TestRunStats&) override {
    for (const std::string& message : messages()) std::printf("%s\n", message.c_str());
  }
};
CATCH_REGISTER_LISTENER(Listener)

}  // namespace stgs::testing

int main(int argc, char** argv) {
  using namespace stgs;
  const auto renderer = testing::make_renderer_under_test({});
  if (renderer.status().code() == StatusCode::kUnsupported) {
    std::printf("skipped: %s\n", renderer.status().message().c_str());
    return 77;
  }
  const int failed = Catch::Session().run(argc, argv);
  return failed != 0 ? failed : static_cast<int>(!testing::messages().empty());
}
