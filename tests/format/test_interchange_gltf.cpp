// SPDX-License-Identifier: Apache-2.0
// Export to glTF, the table of interchange formats, and conversion errors.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/format/interchange_formats.h"
#include "stgs/format/math/blend.h"

namespace stgs {
namespace {

using Json = nlohmann::json;

std::uint32_t word(const std::vector<std::uint8_t>& bytes, std::size_t at) {
  std::uint32_t value = 0;
  REQUIRE(at + 4 <= bytes.size());
  std::memcpy(&value, bytes.data() + at, 4);
  return value;
}

struct Glb {
  Json json;
  std::vector<std::uint8_t> data;

  FloatArray floats(const std::string& attribute) const {
    const Json& primitive = json["meshes"][0]["primitives"][0];
    const Json& accessor = json["accessors"][primitive["attributes"][attribute].get<std::size_t>()];
    CHECK(accessor["componentType"] == 5126);
    const Json& view = json["bufferViews"][accessor["bufferView"].get<std::size_t>()];
    FloatArray out(view["byteLength"].get<std::size_t>() / 4);
    const auto offset = view["byteOffset"].get<std::size_t>();
    CHECK(offset % 4 == 0);
    REQUIRE(offset + 4 * out.size() <= data.size());
    std::memcpy(out.data(), data.data() + offset, 4 * out.size());
    return out;
  }
};

// Parses a GLB and checks its container (glTF 2.0, 4.4).
Glb parse(const std::vector<std::uint8_t>& bytes) {
  CHECK(word(bytes, 0) == 0x46546C67);
  CHECK(word(bytes, 4) == 2);
  CHECK(word(bytes, 8) == bytes.size());
  const std::size_t text = word(bytes, 12);
  CHECK(word(bytes, 16) == 0x4E4F534A);
  CHECK(text % 4 == 0);
  Glb glb;
  glb.json =
      Json::parse(bytes.begin() + 20, bytes.begin() + 20 + static_cast<std::ptrdiff_t>(text));
  CHECK(word(bytes, 20 + text) == bytes.size() - 28 - text);
  CHECK(word(bytes, 24 + text) == 0x004E4942);
  glb.data.assign(bytes.begin() + 28 + static_cast<std::ptrdiff_t>(text), bytes.end());
  CHECK(glb.json["buffers"][0]["byteLength"] == glb.data.size());
  return glb;
}

}  // namespace

TEST_CASE("glTF export writes every attribute, with flipped axes") {
  Gaussians4D set = testing::random_scene(30, 3, 6, 8).gaussians;
  set_static_lifespan(set);
  const auto bytes = write_glb(set);
  REQUIRE(bytes.ok());
  const Glb glb = parse(*bytes);
  CHECK(glb.json["extensionsUsed"] == Json::array({"KHR_gaussian_splatting"}));
  const Json& primitive = glb.json["meshes"][0]["primitives"][0];
  CHECK(primitive["mode"] == 0);
  const Json& extension = primitive["extensions"]["KHR_gaussian_splatting"];
  CHECK(extension["kernel"] == "ellipse");
  CHECK(extension["colorSpace"] == "srgb_rec709_display");
  CHECK(glb.json["scenes"][0]["nodes"] == Json::array({0}));
  CHECK(primitive["attributes"].size() == 1 + 3 + 16 + 1);

  Gaussians4D flipped = set;
  flip_axes(flipped, -1, -1, 1);
  CHECK(glb.floats("POSITION") == flipped.position);
  const auto scale = glb.floats("KHR_gaussian_splatting:SCALE");
  const auto rotation = glb.floats("KHR_gaussian_splatting:ROTATION");
  const auto opacity = glb.floats("KHR_gaussian_splatting:OPACITY");
  const auto constant = glb.floats("KHR_gaussian_splatting:SH_DEGREE_0_COEF_0");
  const auto highest = glb.floats("KHR_gaussian_splatting:SH_DEGREE_3_COEF_6");
  REQUIRE(opacity.size() == set.size());
  for (std::size_t i = 0; i < set.size(); ++i) {
    const float* q = flipped.rotation.data() + 4 * i;
    const float length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (std::size_t c = 0; c < 4; ++c) {
      CHECK(rotation[4 * i + c] == Approx(q[(c + 1) % 4] / length).margin(1e-6));
    }
    for (std::size_t c = 0; c < 3; ++c) {
      CHECK(scale[3 * i + c] == Approx(std::exp(set.log_scale[3 * i + c])));
      CHECK(constant[3 * i + c] == set.sh[48 * i + c]);
      CHECK(highest[3 * i + c] == -set.sh[48 * i + 45 + c]);  // odd in x
    }
    CHECK(opacity[i] == math::opacity_of(set.opacity_logit[i]));
  }
  const Json& accessor = glb.json["accessors"][primitive["attributes"]["POSITION"].get<int>()];
  for (std::size_t c = 0; c < 3; ++c) {
    float low = flipped.position[c];
    for (std::size_t i = c; i < flipped.position.size(); i += 3) {
      low = std::min(low, flipped.position[i]);
    }
    CHECK(accessor["min"][c].get<float>() == low);
  }
  CHECK(write_glb(Gaussians4D{}).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("every format has an extension and can be read or written") {
  for (const InterchangeFormat& format : interchange_formats()) {
    const bool has_extension = format.extension[0] == '.';
    const bool is_old_stgs = std::string(format.name) == "STGS 1";  // recognised by its content
    CHECK((has_extension || is_old_stgs || format.settings_kind == InterchangeFormat::kSequence));
    CHECK((format.read != nullptr || format.read_path != nullptr || format.is_writable()));
    if (format.is_writable())
      CHECK(format_for_output(std::string("a") + format.extension) == &format);
  }
  CHECK(format_for_output("A.PLY") != nullptr);
  CHECK(format_for_output("a.stgs") == nullptr);
  CHECK(format_for_output("ply") == nullptr);
}

TEST_CASE("a written file is recognised by its content") {
  Gaussians4D set = testing::random_scene(5, 0, 6, 8).gaussians;
  for (const InterchangeFormat& format : interchange_formats()) {
    if (format.write == nullptr) continue;
    const auto bytes = format.write(set, math::kDilated, nullptr);
    REQUIRE(bytes.ok());
    for (const InterchangeFormat& other : interchange_formats()) {
      CHECK(other.matches("x", *bytes, {}) == (&other == &format));
    }
  }
}

TEST_CASE("conversion errors measure the known differences") {
  Scene scene = static_scene(testing::random_scene(4, 1, 6, 8).gaussians);
  Gaussians4D &b = scene.gaussians, a = b;
  CHECK(conversion_errors(a, scene)->position_max == 0);
  CHECK(conversion_errors(a, scene)->rotation_max < 1e-4);
  b.position[4] += 0.5f;
  b.log_scale[2] -= 0.25f;
  b.sh[7] += 0.125f;
  for (std::size_t c = 0; c < 4; ++c) b.rotation[c] *= -2;  // the same rotation
  a.rotation[4] = 1, a.rotation[5] = a.rotation[6] = a.rotation[7] = 0;
  b.rotation[4] = std::cos(0.25f), b.rotation[5] = std::sin(0.25f);
  b.rotation[6] = b.rotation[7] = 0;
  const auto errors = conversion_errors(a, scene);
  REQUIRE(errors.ok());
  CHECK(errors->position_max == Approx(0.5));
  CHECK(errors->position_rms == Approx(0.25));
  CHECK(errors->log_scale_max == Approx(0.25));
  CHECK(errors->sh_max == Approx(0.125).epsilon(1e-5));
  CHECK(errors->rotation_max == Approx(28.6479));
  CHECK(errors->colour_max == 0);
  a.resize(3);
  CHECK_FALSE(conversion_errors(a, scene).ok());
}

TEST_CASE("conversion errors ignore permuted axes and the start of a straight path") {
  Scene scene = testing::random_scene(2, 0, 6, 8);
  Gaussians4D& b = scene.gaussians;
  b.opacity_logit = {2, 2};
  b.time = {3, 3};
  b.sigma = b.radius = {2, 2};
  const Gaussians4D a = b;
  // A quarter turn about its own x axis swaps y and z.
  const float* q = a.rotation.data();
  const float half = std::sqrt(0.5f);
  b.rotation[0] = half * (q[0] - q[1]), b.rotation[1] = half * (q[0] + q[1]);
  b.rotation[2] = half * (q[2] + q[3]), b.rotation[3] = half * (q[3] - q[2]);
  std::swap(b.log_scale[1], b.log_scale[2]);
  for (std::size_t c = 0; c < 3; ++c) {
    b.velocity[c] = 0.5f;
    b.position[c] += 0.5f * 1.5f;
  }
  b.time[0] += 1.5f;
  Gaussians4D expected = a;
  std::fill_n(expected.velocity.begin(), 3, 0.5f);
  auto errors = conversion_errors(expected, scene);
  REQUIRE(errors.ok());
  CHECK(errors->rotation_max < 0.01);
  CHECK(errors->log_scale_max < 1e-6);
  CHECK(errors->position_max < 1e-5);
  CHECK(errors->time_max == 1.5);
  CHECK(errors->visibility_max > 0.1);  // it is visible later
  b.time[0] -= 1.5f;
  for (std::size_t c = 0; c < 3; ++c) b.position[c] -= 0.5f * 1.5f;
  b.sigma[0] *= 1.25f;
  b.radius[0] += 0.75f;
  errors = conversion_errors(expected, scene);
  CHECK(errors->time_max == 0);
  CHECK(errors->sigma_max == Approx(std::log(1.25)));
  CHECK(errors->radius_max == Approx(0.75));
}

TEST_CASE("a format that cannot state the kernel of the splats gets a note") {
  Scene scene = testing::random_scene(5, 0, 6, 8);
  scene.metadata.kernel = math::kBandLimited;
  for (const InterchangeFormat& format : interchange_formats()) {
    if (!format.is_writable()) continue;
    ConversionNotes notes;
    const auto bytes = format.write != nullptr
                           ? format.write(scene.gaussians, math::kBandLimited, &notes)
                           : format.write_scene(scene, {}, &notes, nullptr);
    REQUIRE(bytes.ok());
    const bool noted = std::any_of(notes.begin(), notes.end(), [](const std::string& note) {
      return note.find("band-limited") != std::string::npos;
    });
    INFO(format.name);
    CHECK(noted == (std::string(format.name) != "SPZ"));
  }
}

TEST_CASE("a set that cannot be rendered is not written") {
  const Gaussians4D good = testing::random_scene(4, 1, 6, 8).gaussians;
  std::vector<Gaussians4D> bad(5, good);
  bad[0].position[5] = std::nanf("");
  bad[1].sh[11] = INFINITY;
  for (std::size_t c = 0; c < 4; ++c) bad[2].rotation[4 + c] = 0;
  bad[3].log_scale.pop_back();
  bad[4].sh_degree = 2;
  for (const InterchangeFormat& format : interchange_formats()) {
    if (format.write == nullptr) continue;
    CHECK(format.write(good, math::kDilated, nullptr).ok());
    for (const Gaussians4D& set : bad) {
      CHECK(format.write(set, math::kDilated, nullptr).status().code() == StatusCode::kUsage);
    }
  }
}

}  // namespace stgs
