// SPDX-License-Identifier: Apache-2.0
// The example embed_vulkan: its cube and the scene's splats hide each other as their depths say,
// and the validation layer, where it is installed, has nothing to say. Exit code 77: there is no
// device.
#include <stdlib.h>
#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#define STB_IMAGE_IMPLEMENTATION
#define STBI_ONLY_PNG
#include <stb_image.h>

#include "../api/temporary_folder.h"
#include "catch.h"
#include "catch_runner.h"
#include "stgs/format/scene_file.h"

namespace stgs::testing {
namespace {

constexpr int kWidth = 160, kHeight = 120;
constexpr int kUnsupported = 5;

using Colour = std::array<int, 3>;

// An opaque splat that stands still, of those standard deviations.
void add(Gaussians4D& set, std::size_t i, std::array<float, 3> position, float wide, float thick,
         std::array<float, 3> colour) {
  for (std::size_t c = 0; c < 3; ++c) {
    set.position[3 * i + c] = position[c];
    set.log_scale[3 * i + c] = std::log(c < 2 ? wide : thick);
    set.sh[3 * i + c] = (colour[c] - 0.5f) / 0.28209479f;
  }
  set.rotation[4 * i] = 1;
  set.opacity_logit[i] = 12;
  set.time[i] = 15;
  set.sigma[i] = set.radius[i] = 1000;
}

// A blue wall at z = 8, a green ball before it at z = 3, left of the middle.
std::string write_scene_to(const TemporaryFolder& folder, bool with_camera = true) {
  Scene scene;
  scene.metadata.time_base = {1, 30};
  scene.metadata.frames = 30;
  scene.metadata.near_plane = 0.1f;
  scene.metadata.background[0] = 1;  // which the application does not take
  StartCamera start;
  start.fx = start.fy = 120;
  start.cx = kWidth / 2.0f;
  start.cy = kHeight / 2.0f;
  start.width = kWidth;
  start.height = kHeight;
  if (with_camera) scene.metadata.start_camera = start;
  scene.gaussians.sh_degree = 0;
  scene.gaussians.resize(2);
  add(scene.gaussians, 0, {0, 0, 8}, 60, 0.01f, {0, 0, 1});
  add(scene.gaussians, 1, {-0.25f, 0, 3}, 0.1f, 0.1f, {0, 1, 0});
  const std::string path = folder / "wall.stgs";
  REQUIRE(write_scene(path, scene, {}).ok());
  return path;
}

// Runs the example; what it says.
std::string run(const std::string& arguments, int& code) {
  const std::string command = std::string(STGS_EXAMPLE) + " " + arguments + " 2>&1";
  FILE* pipe = popen(command.c_str(), "r");
  std::string said;
  if (pipe == nullptr) return said;
  for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) said += static_cast<char>(c);
  code = WEXITSTATUS(pclose(pipe));
  return said;
}

class Picture {
 public:
  // With the cube there.
  Picture(const TemporaryFolder& folder, const std::string& scene, const char* cube,
          int wide = kWidth, int high = kHeight)
      : width_(wide) {
    const std::string path = folder / "picture.png";
    int code = -1;
    const std::string said = run(scene + " 0.5 " + path + " " + cube, code);
    INFO(said);
    REQUIRE(code == 0);
    CHECK(said.empty());
    int width = 0, height = 0, channels = 0;
    pixels_.reset(stbi_load(path.c_str(), &width, &height, &channels, 3));
    REQUIRE(width == wide);
    REQUIRE(height == high);
  }
  Colour at(int x, int y) const {
    const std::uint8_t* p = pixels_.get() + 3 * (y * width_ + x);
    return {p[0], p[1], p[2]};
  }

 private:
  const int width_;
  std::unique_ptr<std::uint8_t, void (*)(void*)> pixels_{nullptr, stbi_image_free};
};

bool is_blue(Colour c) {
  return c[2] > 240 && c[0] < 15 && c[1] < 15;
}
bool is_green(Colour c) {
  return c[1] > 240 && c[0] < 15 && c[2] < 15;
}
bool is_orange(Colour c) {
  return c[0] > 120 && c[1] > 60 && c[1] < c[0] - 40 && c[2] < 40;
}

}  // namespace

TEST_CASE("splats before the cube cover it, and it hides those behind it") {
  const TemporaryFolder folder;
  const Picture picture(folder, write_scene_to(folder), "0 0 5 0.8");
  CHECK(is_green(picture.at(70, 60)));
  CHECK(is_orange(picture.at(90, 60)));
  CHECK(is_blue(picture.at(20, 20)));
  // The plate's near edge is before the wall, and hides it too.
  const Colour plate = picture.at(100, 92);
  CHECK(std::abs(plate[0] - plate[2]) < 10);
}

TEST_CASE("a cube behind all splats is hidden, and one before all of them hides them") {
  const TemporaryFolder folder;
  const std::string scene = write_scene_to(folder);
  const Picture behind(folder, scene, "0 0 12 0.8");
  const Picture before(folder, scene, "-0.15 0 2 0.3");
  for (const int x : {80, 84, 88}) {
    CHECK(is_blue(behind.at(x, 60)));
    CHECK(is_orange(before.at(x, 60)));
  }
  CHECK(is_green(behind.at(70, 60)));
  CHECK(is_orange(before.at(70, 60)));
}

TEST_CASE("a scene without a start camera is seen from before its bounds") {
  const TemporaryFolder folder;
  const Picture picture(folder, write_scene_to(folder, false), "", 1280, 720);
  CHECK(is_blue(picture.at(20, 20)));
  CHECK(is_green(picture.at(512, 360)));  // 0.625 from the camera, 0.125 left of it
}

TEST_CASE("a file that is none is told of") {
  const TemporaryFolder folder;
  int code = 0;
  const std::string said = run(folder / "none.stgs" + " 0 " + folder / "a.png", code);
  CHECK(code == 4);
  CHECK(said.find("none.stgs") != std::string::npos);
}

}  // namespace stgs::testing

int main(int argc, char** argv) {
  using namespace stgs::testing;
  // Validation as the loader and the layer take it from the environment: messages on standard
  // output.
  setenv("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation", 1);
  setenv("VK_LAYER_ENABLES", "VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT", 1);
  int code = 0;
  if (const std::string said = run("none.stgs 0 none.png", code); code == kUnsupported) {
    std::printf("skipped: %s\n", said.c_str());
    return 77;
  }
  return stgs::testing::run_cases(argc, argv);
}
