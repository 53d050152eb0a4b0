// SPDX-License-Identifier: Apache-2.0
// The example embed_vulkan: its cube and the scene's splats occlude each other by depth, and the
// validation layer, if installed, reports nothing. Exit code 77: no Vulkan device.
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

#include "../fixtures/temporary_folder.h"
#include "catch.h"
#include "catch_runner.h"
#include "stgs/format/scene_file.h"

namespace stgs::testing {
namespace {

constexpr int kWidth = 160, kHeight = 120;
constexpr int kUnsupported = 5;

using Colour = std::array<int, 3>;

// Sets an opaque static splat with standard deviations `width` (x, y) and `depth` (z).
void set_splat(Gaussians4D& set, std::size_t i, std::array<float, 3> position, float width,
               float depth, std::array<float, 3> colour) {
  for (std::size_t c = 0; c < 3; ++c) {
    set.position[3 * i + c] = position[c];
    set.log_scale[3 * i + c] = std::log(c < 2 ? width : depth);
    set.sh[3 * i + c] = (colour[c] - 0.5f) / 0.28209479f;
  }
  set.rotation[4 * i] = 1;
  set.opacity_logit[i] = 12;
  set.time[i] = 15;
  set.sigma[i] = set.radius[i] = 1000;
}

// A blue wall at z = 8, and a green ball in front of it at z = 3, left of the centre.
std::string write_scene_to(const TemporaryFolder& folder, bool with_camera = true) {
  Scene scene;
  scene.metadata.time_base = {1, 30};
  scene.metadata.frames = 30;
  scene.metadata.near_plane = 0.1f;
  scene.metadata.background[0] = 1;  // ignored by the application
  StartCamera start;
  start.fx = start.fy = 120;
  start.cx = kWidth / 2.0f;
  start.cy = kHeight / 2.0f;
  start.width = kWidth;
  start.height = kHeight;
  if (with_camera) scene.metadata.start_camera = start;
  scene.gaussians.sh_degree = 0;
  scene.gaussians.resize(2);
  set_splat(scene.gaussians, 0, {0, 0, 8}, 60, 0.01f, {0, 0, 1});
  set_splat(scene.gaussians, 1, {-0.25f, 0, 3}, 0.1f, 0.1f, {0, 1, 0});
  const std::string path = folder / "wall.stgs";
  REQUIRE(write_scene(path, scene, {}).ok());
  return path;
}

// Runs the example; returns its output and sets its exit code.
std::string run(const std::string& arguments, int& code) {
  const std::string command = std::string(STGS_EXAMPLE) + " " + arguments + " 2>&1";
  FILE* pipe = popen(command.c_str(), "r");
  std::string output;
  if (pipe == nullptr) return output;
  for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) output += static_cast<char>(c);
  code = WEXITSTATUS(pclose(pipe));
  return output;
}

class Image {
 public:
  // `cube`: the example's arguments for the cube's position and size.
  Image(const TemporaryFolder& folder, const std::string& scene, const char* cube,
        int width = kWidth, int height = kHeight)
      : width_(width) {
    const std::string path = folder / "image.png";
    int code = -1;
    const std::string output = run(scene + " 0.5 " + path + " " + cube, code);
    INFO(output);
    REQUIRE(code == 0);
    CHECK(output.empty());
    int loaded_width = 0, loaded_height = 0, channels = 0;
    pixels_.reset(stbi_load(path.c_str(), &loaded_width, &loaded_height, &channels, 3));
    REQUIRE(loaded_width == width);
    REQUIRE(loaded_height == height);
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

TEST_CASE("the cube is occluded by splats in front of it and occludes splats behind it") {
  const TemporaryFolder folder;
  const Image image(folder, write_scene_to(folder), "0 0 5 0.8");
  CHECK(is_green(image.at(70, 60)));
  CHECK(is_orange(image.at(90, 60)));
  CHECK(is_blue(image.at(20, 20)));
  // The plate's near edge is in front of the wall and occludes it.
  const Colour plate = image.at(100, 92);
  CHECK(std::abs(plate[0] - plate[2]) < 10);
}

TEST_CASE("a cube behind all splats is hidden, and one in front of them hides them") {
  const TemporaryFolder folder;
  const std::string scene = write_scene_to(folder);
  const Image behind(folder, scene, "0 0 12 0.8");
  const Image front(folder, scene, "-0.15 0 2 0.3");
  for (const int x : {80, 84, 88}) {
    CHECK(is_blue(behind.at(x, 60)));
    CHECK(is_orange(front.at(x, 60)));
  }
  CHECK(is_green(behind.at(70, 60)));
  CHECK(is_orange(front.at(70, 60)));
}

TEST_CASE("a scene without a start camera is rendered from in front of its bounds") {
  const TemporaryFolder folder;
  const Image image(folder, write_scene_to(folder, false), "", 1280, 720);
  CHECK(is_blue(image.at(20, 20)));
  CHECK(is_green(image.at(512, 360)));  // 0.625 from the camera, 0.125 left of it
}

TEST_CASE("a missing file is reported") {
  const TemporaryFolder folder;
  int code = 0;
  const std::string output = run(folder / "none.stgs" + " 0 " + folder / "a.png", code);
  CHECK(code == 4);
  CHECK(output.find("none.stgs") != std::string::npos);
}

}  // namespace stgs::testing

int main(int argc, char** argv) {
  using namespace stgs::testing;
  // The loader and the layer read these variables; the layer prints to standard output.
  setenv("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation", 1);
  setenv("VK_LAYER_ENABLES", "VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT", 1);
  int code = 0;
  if (const std::string output = run("none.stgs 0 none.png", code); code == kUnsupported) {
    std::printf("skipped: %s\n", output.c_str());
    return 77;
  }
  return stgs::testing::run_cases(argc, argv);
}
