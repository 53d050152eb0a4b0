// SPDX-License-Identifier: Apache-2.0
// Snapshots of a scene, flipped axes, and reading and writing of PLY.
#include <cmath>
#include <cstring>
#include <limits>
#include <span>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/format/interchange.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/raster.h"

namespace stgs {
namespace {

// `n` static, visible primitives.
Gaussians4D fixture_set(int degree, std::size_t n = 40) {
  Gaussians4D set = testing::random_scene(n, degree, 6, 3).gaussians;
  for (float& logit : set.opacity_logit) logit = std::abs(logit);
  set_static_lifespan(set);
  return set;
}

Result<Scene> read(std::vector<std::uint8_t> bytes, ConversionNotes* notes = nullptr,
                   const ReadLimits& limits = {}) {
  return read_ply(*memory_source(std::move(bytes), "test.ply"), limits, notes);
}
Result<Scene> read_text(const std::string& text, ConversionNotes* notes = nullptr) {
  return read({text.begin(), text.end()}, notes);
}

math::PinholeCamera small_camera() {
  math::PinholeCamera camera{};
  camera.rotation.xx = camera.rotation.yy = camera.rotation.zz = 1;
  camera.fx = camera.fy = 60;
  camera.cx = 32;
  camera.cy = 24;
  camera.width = 64;
  camera.height = 48;
  camera.near_plane = 0.1f;
  return camera;
}

std::vector<float> render_at(const Gaussians4D& set, float ticks,
                             const math::PinholeCamera& camera) {
  SplatFrame splats;
  RasterOutput output;
  render(set, ticks, camera, {}, splats, output);
  return output.colour.data;
}

float largest_difference(std::span<const float> a, std::span<const float> b) {
  REQUIRE(a.size() == b.size());
  float largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
  return largest;
}

const char* kAsciiHeader =
    "ply\r\nformat ascii 1.0\r\ncomment by hand\r\nelement note 2\r\nproperty int a\r\n"
    "element vertex 1\r\nproperty float opacity\r\nproperty float rot_3\r\nproperty float rot_2\r\n"
    "property float rot_1\r\nproperty float rot_0\r\nproperty double x\r\nproperty short y\r\n"
    "property float z\r\nproperty uchar red\r\nproperty float f_dc_0\r\nproperty float f_dc_1\r\n"
    "property float f_dc_2\r\nproperty float scale_0\r\nproperty float scale_1\r\n"
    "property float scale_2\r\nend_header\r\n";

}  // namespace

TEST_CASE("a snapshot renders the image that the scene renders at that time") {
  Scene scene = testing::random_scene(300, 2, 12, 5);
  for (float& s : scene.gaussians.log_scale) s += 1.5f;
  for (const double ticks : {0.0, 3.25, 12.0}) {
    const Result<Gaussians4D> snapshot = snapshot_at(scene, ticks);
    REQUIRE(snapshot.ok());
    CHECK(snapshot->size() < scene.gaussians.size());
    const auto camera = small_camera();
    const auto expected = render_at(scene.gaussians, static_cast<float>(ticks), camera);
    CHECK(largest_difference(expected, render_at(*snapshot, 0.0f, camera)) < 1e-5f);
    CHECK(largest_difference(expected, render_at(*snapshot, 1.0f, camera)) < 1e-5f);
  }
  CHECK(snapshot_at(scene, 12.5).status().code() == StatusCode::kUsage);
  CHECK(snapshot_at(scene, std::nan("")).status().code() == StatusCode::kUsage);
}

TEST_CASE("a snapshot holds the primitives of the part at that time") {
  Scene scene = testing::random_scene(20, 0, 10, 5);
  for (float& logit : scene.gaussians.opacity_logit) logit = 3;
  set_static_lifespan(scene.gaussians, 10);
  scene.parts = {{0, 4, 5}, {4, 10, 15}};
  CHECK(snapshot_at(scene, 0)->size() == 5);
  CHECK(snapshot_at(scene, 3.99)->size() == 5);
  CHECK(snapshot_at(scene, 4)->size() == 15);
  CHECK(snapshot_at(scene, 10)->size() == 15);
}

TEST_CASE("a flipped scene seen by a flipped camera gives the same image") {
  Gaussians4D set = fixture_set(3);
  for (float& s : set.log_scale) s += 1.5f;
  math::PinholeCamera camera = small_camera();
  const auto before = render_at(set, 0, camera);
  Gaussians4D flipped = set;
  flip_axes(flipped, 1, -1, -1);
  camera.rotation.yy = camera.rotation.zz = -1;
  CHECK(largest_difference(before, render_at(flipped, 0, camera)) < 1e-5f);
  flip_axes(flipped, 1, -1, -1);
  CHECK(testing::fingerprints(flipped) == testing::fingerprints(set));
}

TEST_CASE("SH are mirrored with their axes") {
  const Gaussians4D set = fixture_set(3, 1);
  const auto value = [](const Gaussians4D& s, float x, float y, float z) {
    const math::ShBasis basis = math::sh_basis(math::vec3_of(x, y, z));
    float sum = 0;
    for (std::size_t k = 0; k < 16; ++k) sum += basis.v[k] * s.sh[3 * k];
    return sum;
  };
  const int signs[][3] = {{-1, 1, 1}, {1, -1, 1}, {1, 1, -1}, {-1, -1, 1}, {-1, -1, -1}};
  for (const auto& sign : signs) {
    Gaussians4D mirrored = set;
    flip_axes(mirrored, sign[0], sign[1], sign[2]);
    const float x = 0.48f, y = -0.6f, z = 0.64f;
    CHECK(value(mirrored, x * static_cast<float>(sign[0]), y * static_cast<float>(sign[1]),
                z * static_cast<float>(sign[2])) == Approx(value(set, x, y, z)));
  }
}

TEST_CASE("PLY preserves every float") {
  for (int degree = 0; degree <= 3; ++degree) {
    const Gaussians4D set = fixture_set(degree);
    const auto bytes = write_ply(set);
    REQUIRE(bytes.ok());
    ConversionNotes notes;
    const Result<Scene> back = read(*bytes, &notes);
    REQUIRE(back.ok());
    CHECK(notes.empty());
    CHECK(back->metadata.frames == 1);
    CHECK(back->gaussians.sh_degree == degree);
    CHECK(testing::fingerprints(back->gaussians) == testing::fingerprints(set));
  }
}

TEST_CASE("PLY stores SH by channel") {
  Gaussians4D set = fixture_set(1, 1);
  for (std::size_t k = 0; k < 12; ++k) set.sh[k] = static_cast<float>(k);
  const auto bytes = write_ply(set);
  const float* record =
      reinterpret_cast<const float*>(bytes->data() + bytes->size() - 26 * sizeof(float));
  std::vector<float> rest(9);
  std::memcpy(rest.data(), record + 9, sizeof(float) * rest.size());
  CHECK(rest == std::vector<float>{3, 6, 9, 4, 7, 10, 5, 8, 11});
}

TEST_CASE("ASCII PLY is read with properties in any order and of any type") {
  const Result<Scene> scene =
      read_text(std::string(kAsciiHeader) + "7 8\n2 .5 0 0 1 1.5 -3 4e0 255 .1 .2 .3 -1 -2 -3\n");
  REQUIRE(scene.ok());
  const Gaussians4D& set = scene->gaussians;
  CHECK(set.position == FloatArray{1.5f, -3, 4});
  CHECK(set.rotation == FloatArray{1, 0, 0, 0.5f});
  CHECK(set.sh == FloatArray{.1f, .2f, .3f});
  CHECK(set.log_scale == FloatArray{-1, -2, -3});
  CHECK(set.opacity_logit == FloatArray{2});
  const auto unusual = read_text(std::string(kAsciiHeader) +
                                 "7 8\n+2 .5 1e-400 0 1 +1.5 -3 +4e0 255 .1 .2 -1e-999 -1 -2 -3\n");
  REQUIRE(unusual.ok());
  CHECK(unusual->gaussians.position == FloatArray{1.5f, -3, 4});
  CHECK(unusual->gaussians.rotation == FloatArray{1, 0, 0, 0.5f});
  CHECK(unusual->gaussians.sh == FloatArray{.1f, .2f, 0});
  const std::string rest = " .5 0 0 1 1.5 -3 4e0 255 .1 .2 .3 -1 -2 -3\n";
  CHECK(read_text(std::string(kAsciiHeader) + "7 8\n1e400" + rest)->gaussians.size() == 0);
  CHECK_FALSE(read_text(std::string(kAsciiHeader) + "7 8\n+-2" + rest).ok());
  const auto cut = read_text(std::string(kAsciiHeader) + "7 8\n2 .5 0 0 1 1.5 -3 4e0 255 .1 .2");
  CHECK(cut.status().code() == StatusCode::kInvalidFile);
}

TEST_CASE("primitives of a PLY that cannot be rendered are dropped and reported") {
  std::vector<std::uint8_t> bytes = *write_ply(fixture_set(1));
  constexpr std::size_t kWidth = 26;  // floats per vertex; opacity is number 18, rot_0 is 22
  const auto change = [&bytes](std::size_t vertex, std::size_t field, float value) {
    const std::size_t body = bytes.size() - 40 * kWidth * sizeof(float);
    std::memcpy(bytes.data() + body + (vertex * kWidth + field) * sizeof(float), &value,
                sizeof(float));
  };
  constexpr float kInf = std::numeric_limits<float>::infinity();
  change(1, 0, std::numeric_limits<float>::quiet_NaN());
  change(5, 12, kInf);
  for (std::size_t c = 0; c < 4; ++c) change(9, 22 + c, 0);
  change(20, 18, kInf);   // opacity 1
  change(21, 19, -kInf);  // scale 0
  ConversionNotes notes;
  const Result<Scene> back = read(bytes, &notes);
  REQUIRE(back.ok());
  CHECK(back->gaussians.size() == 37);
  REQUIRE(notes.size() == 1);
  CHECK_THAT(notes[0], Catch::Contains("dropped 3 of 40 primitives"));
  CHECK(encode_scene(*back, {}).ok());
}

TEST_CASE("a PLY truncated at any byte is rejected") {
  const auto complete = *write_ply(fixture_set(1, 3));
  for (std::size_t size = 0; size < complete.size(); ++size) {
    const auto cut = read({complete.begin(), complete.begin() + static_cast<std::ptrdiff_t>(size)});
    REQUIRE_FALSE(cut.ok());
    CHECK(cut.status().code() == StatusCode::kInvalidFile);
  }
}

TEST_CASE("a PLY header that exceeds the file is rejected before memory is allocated") {
  const std::string properties =
      "property float x\nproperty float y\nproperty float z\nproperty float f_dc_0\n"
      "property float f_dc_1\nproperty float f_dc_2\nproperty float opacity\n"
      "property float scale_0\nproperty float scale_1\nproperty float scale_2\n"
      "property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3\n";
  const std::string binary = "ply\nformat binary_little_endian 1.0\n";
  const auto code = [](const std::string& text) { return read_text(text).status().code(); };
  for (const char* count : {"18446744073709551615", "4294967296", "1"}) {
    const std::string rest = fmt::format("element vertex {}\n{}end_header\n", count, properties);
    CHECK(code(binary + rest) == StatusCode::kInvalidFile);
    CHECK_FALSE(read_text("ply\nformat ascii 1.0\n" + rest).ok());
  }
  CHECK(code(binary + "element vertex -1\n" + properties + "end_header\n") ==
        StatusCode::kInvalidFile);
  CHECK(code(binary + "element vertex 99999999999999999999999\n" + properties + "end_header\n") ==
        StatusCode::kInvalidFile);
  CHECK(code(binary + "property float x\nend_header\n") == StatusCode::kInvalidFile);
  CHECK(code(binary + "element vertex 0\nproperty float x\nproperty float x\nend_header\n") ==
        StatusCode::kInvalidFile);
  CHECK(code("ply\nformat binary_big_endian 1.0\nend_header\n") == StatusCode::kUnsupported);
  CHECK(code(binary + "element vertex 0\nproperty float x\nend_header\n") ==
        StatusCode::kUnsupported);
  CHECK(code(binary + "element face 1\nproperty list uchar int i\nelement vertex 0\n" + properties +
             "end_header\n") == StatusCode::kUnsupported);
  CHECK(code(binary + "element vertex 0\n" + properties +
             "property float f_rest_0\nend_header\n") == StatusCode::kUnsupported);
  CHECK(read_text(binary + "element vertex 0\n" + properties + "end_header\n").ok());
}

TEST_CASE("the caller's limits apply to PLY") {
  const auto bytes = *write_ply(fixture_set(3));
  CHECK(read(bytes, nullptr, {.max_primitives = 40}).ok());
  CHECK(read(bytes, nullptr, {.max_primitives = 39}).status().code() == StatusCode::kUnsupported);
  constexpr std::uint64_t kBytes = 40 * 4 * (65 + 62);  // in memory, and in the file
  CHECK(read(bytes, nullptr, {.max_memory = kBytes}).ok());
  const Status status = read(bytes, nullptr, {.max_memory = kBytes - 1}).status();
  CHECK(status.code() == StatusCode::kUnsupported);
  CHECK_THAT(status.message(), Catch::Contains("memory limit of 20319 bytes (need 20320 bytes)") &&
                                   Catch::Contains("allow more memory"));
}

namespace {

// A packed PLY of one chunk: `count` primitives of four packed words each, SH of degree 1.
std::vector<std::uint8_t> packed_ply(std::size_t count, bool colour_bounds) {
  std::string header = "ply\nformat binary_little_endian 1.0\nelement chunk 1\n";
  std::vector<float> bounds = {-1, -2, -3, 1, 2, 3, -4, -4, -4, -2, -2, -2};
  for (const char* side : {"min_", "max_"}) {
    for (const char* axis : {"x", "y", "z"})
      header += fmt::format("property float {}{}\n", side, axis);
  }
  for (const char* side : {"min_scale_", "max_scale_"}) {
    for (const char* axis : {"x", "y", "z"})
      header += fmt::format("property float {}{}\n", side, axis);
  }
  if (colour_bounds) {
    for (const char* side : {"min_", "max_"}) {
      for (const char* axis : {"r", "g", "b"})
        header += fmt::format("property float {}{}\n", side, axis);
    }
    bounds.insert(bounds.end(), {-.5f, -.5f, -.5f, 1.5f, 1.5f, 1.5f});
  }
  header += fmt::format("element vertex {}\n", count);
  for (const char* word : {"position", "rotation", "scale", "color"}) {
    header += fmt::format("property uint packed_{}\n", word);
  }
  header += fmt::format("element sh {}\n", count);
  for (int k = 0; k < 9; ++k) header += fmt::format("property uchar f_rest_{}\n", k);
  header += "end_header\n";
  std::vector<std::uint8_t> bytes(header.begin(), header.end());
  const auto append = [&bytes](const void* data, std::size_t size) {
    const auto* p = static_cast<const std::uint8_t*>(data);
    bytes.insert(bytes.end(), p, p + size);
  };
  append(bounds.data(), bounds.size() * sizeof(float));
  for (std::size_t i = 0; i < count; ++i) {
    // Position: x at its maximum, y at its minimum, z at its maximum. Rotation: y is the
    // largest, the others are near 0.
    const std::uint32_t words[] = {2047u << 21 | 2047u, 2u << 30 | 512u << 20 | 512u << 10 | 512u,
                                   0u, 255u << 24 | 0u << 16 | 51u << 8 | 255u};
    append(words, sizeof(words));
  }
  const std::uint8_t rest[] = {0, 128, 255, 1, 1, 1, 2, 2, 2};
  for (std::size_t i = 0; i < count; ++i) append(rest, sizeof(rest));
  return bytes;
}

}  // namespace

TEST_CASE("packed PLY is read with its bounds, rotations and SH") {
  const Result<Scene> scene = read(packed_ply(3, true));
  REQUIRE(scene.ok());
  const Gaussians4D& set = scene->gaussians;
  REQUIRE(set.size() == 3);
  CHECK(set.sh_degree == 1);
  CHECK(set.position[3] == 1);
  CHECK(set.position[4] == -2);
  CHECK(set.position[5] == 3);
  CHECK(set.log_scale[3] == -4);
  CHECK(set.rotation[4 + 2] == Approx(1).margin(1e-5));
  CHECK(set.rotation[4 + 0] == Approx(0).margin(2e-3));
  CHECK(math::opacity_of(set.opacity_logit[1]) > 254.5 / 255);
  CHECK(set.sh[12] * math::kSh00 + 0.5f == Approx(1.5));
  CHECK(set.sh[13] * math::kSh00 + 0.5f == Approx(-.5));
  CHECK(set.sh[14] * math::kSh00 + 0.5f == Approx(-.5 + 2 * .2));
  CHECK(set.sh[12 + 3] == -4);               // red, coefficient 1
  CHECK(set.sh[12 + 6] == Approx(1. / 64));  // red, coefficient 2
  CHECK(set.sh[12 + 9] == 4);
  CHECK(set.sh[12 + 4] == Approx(-4 + 1.5 / 32));  // green, coefficient 1
  const Result<Scene> plain = read(packed_ply(3, false));
  REQUIRE(plain.ok());
  CHECK(plain->gaussians.sh[12] * math::kSh00 + 0.5f == Approx(1));
  CHECK_FALSE(read(packed_ply(257, true)).ok());  // more than one chunk covers
  const auto complete = packed_ply(2, true);
  for (std::size_t size = 0; size < complete.size(); ++size) {
    const auto cut = read({complete.begin(), complete.begin() + static_cast<std::ptrdiff_t>(size)});
    REQUIRE(cut.status().code() == StatusCode::kInvalidFile);
  }
}

TEST_CASE("a PLY with a changed byte is rejected or read as a valid set") {
  for (const auto& complete : {*write_ply(fixture_set(1, 2)), packed_ply(2, true)}) {
    for (std::size_t at = 0; at < complete.size(); ++at) {
      for (const auto flip : std::initializer_list<std::uint8_t>{0x01, 0x04, 0x80, 0xFF}) {
        auto changed = complete;
        changed[at] ^= flip;
        const Result<Scene> scene = read(changed, nullptr, {.max_memory = 1 << 24});
        if (scene.ok()) CHECK(encode_scene(*scene, {}).ok());
      }
    }
  }
}

}  // namespace stgs
