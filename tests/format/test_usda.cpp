// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <cmath>
#include <map>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/format/interchange.h"

using namespace stgs;
using stgs::testing::random_scene;

namespace {

std::string write_text(const Scene& scene, ConversionNotes* notes = nullptr) {
  const auto bytes = write_usda(scene, notes);
  INFO(bytes.status().message());
  REQUIRE(bytes.ok());
  return {bytes->begin(), bytes->end()};
}

// A prim of a .usda: the values of its attributes, of an array by time; without samples at time -1.
struct Prim {
  std::string type;
  std::map<std::string, std::string> fields;
  std::map<std::string, std::map<int, std::vector<double>>> arrays;
};

std::vector<double> numbers_of(const std::string& text) {
  std::vector<double> out;
  for (const char *at = text.data(), *end = at + text.size(); at < end;) {
    double value = 0;
    const auto [after, error] = std::from_chars(at, end, value);
    if (error != std::errc()) {
      ++at;
      continue;
    }
    out.push_back(value);
    at = after;
  }
  return out;
}

// Parses the subset of the language that the writer uses: one attribute or sample per line.
std::map<std::string, Prim> parse_prims(const std::string& text) {
  std::map<std::string, Prim> prims;
  Prim* prim = nullptr;
  std::string sampled;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    line.erase(0, line.find_first_not_of(' '));
    if (line.rfind("def ", 0) == 0) {
      const std::size_t quote = line.find('"');
      prim = &prims[line.substr(quote + 1, line.size() - quote - 2)];
      prim->type = line.substr(4, quote - 5);
    } else if (line.find(".timeSamples = {") != std::string::npos && line.back() == '{') {
      const std::size_t begin = line.find(' ') + 1;
      sampled = line.substr(begin, line.find('.') - begin);
    } else if (line == "}") {
      sampled.clear();
    } else if (!sampled.empty()) {
      const std::size_t colon = line.find(':');
      prim->arrays[sampled][std::stoi(line)] = numbers_of(line.substr(colon + 1));
    } else if (prim != nullptr && line.find(" = ") != std::string::npos) {
      const std::size_t equals = line.find(" = ");
      const std::size_t begin = line.rfind(' ', equals - 1) + 1;
      const std::string name = line.substr(begin, equals - begin), value = line.substr(equals + 3);
      if (value[0] == '[') {
        prim->arrays[name][-1] = numbers_of(value);
      } else {
        prim->fields[name] = value;
      }
    }
  }
  return prims;
}

// Returns the value of an array at a time, linear between samples as USD interpolates.
std::vector<double> value_at(const Prim& prim, const char* name, double time) {
  const auto& samples = prim.arrays.at(name);
  auto after = samples.lower_bound(static_cast<int>(std::ceil(time)));
  if (after == samples.end()) return samples.rbegin()->second;
  if (after == samples.begin() || after->first == time) return after->second;
  const auto before = std::prev(after);
  const double share = (time - before->first) / (after->first - before->first);
  std::vector<double> out = before->second;
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] += share * (after->second[i] - before->second[i]);
  }
  return out;
}

// Returns whether a prim is visible, by its held samples "time: "token"".
bool is_visible(const Prim& prim, double time) {
  const auto found = prim.fields.find("visibility.timeSamples");
  if (found == prim.fields.end()) return true;
  bool visible = false;
  const std::string& text = found->second;
  for (std::size_t at = text.find_first_of("0123456789"); at != std::string::npos;
       at = text.find_first_of("0123456789", text.find(',', at))) {
    const bool inherited = text.compare(text.find('"', at) + 1, 9, "inherited") == 0;
    if (std::stod(text.substr(at)) <= time || at == 2) visible = inherited;
    if (text.find(',', at) == std::string::npos) break;
  }
  return visible;
}

using Catch::Contains;

}  // namespace

TEST_CASE("USD: a static scene is one prim with known text") {
  Scene scene = static_scene({});
  Gaussians4D& set = scene.gaussians;
  set.resize(2);
  set.position = {1, 2, 3, -0.5f, 0, 0.25f};
  set.log_scale = {0, 0, 0, 0, 0, 0};
  set.rotation = {2, 0, 0, 0, 0, 0, 3, 4};
  set.opacity_logit = {0, 0};
  set.sh = {0.5f, 0.25f, 0, 1, -1, 2};
  set_static_lifespan(set);
  scene.metadata.title = "a \"b\" \\ c\nd";
  scene.metadata.metres_per_unit = 0.5f;
  ConversionNotes notes;
  const std::string text = write_text(scene, &notes);
  CHECK(notes.empty());
  CHECK(text == R"(#usda 1.0
(
    defaultPrim = "Scene"
    doc = "a \"b\" \\ c d"
    metersPerUnit = 0.5
    upAxis = "Y"
)

def Xform "Scene"
{
    def ParticleField3DGaussianSplat "static"
    {
        uniform token projectionModeHint = "perspective"
        uniform token sortingModeHint = "zDepth"
        float3[] extent = [(-3.5, -5, -6), (4, 3, 2.75)]
        point3f[] positions = [(1, -2, -3), (-0.5, 0, -0.25)]
        quatf[] orientations = [(1, 0, -0, -0), (0, 0, -0.6, -0.8)]
        float3[] scales = [(1, 1, 1), (1, 1, 1)]
        float[] opacities = [0.5, 0.5]
        uniform int radiance:sphericalHarmonicsDegree = 0
        float3[] radiance:sphericalHarmonicsCoefficients = [(0.5, 0.25, 0), (1, -1, 2)]
    }
}
)");
}

TEST_CASE("USD: the samples give each frame of a moving scene") {
  Scene scene = random_scene(300, 1, 40, 3);
  // Some that are static, and some that only move.
  for (std::size_t i = 0; i < 60; ++i) {
    scene.gaussians.radius[i] = 50;
    scene.gaussians.time[i] = 20;
    for (std::size_t c = 0; c < 3 && i < 30; ++c) scene.gaussians.velocity[3 * i + c] = 0;
  }
  scene.metadata.start_camera.emplace();
  ConversionNotes notes;
  const std::string text = write_text(scene, &notes);
  CHECK_THAT(text, Contains("startTimeCode = 0"));
  CHECK_THAT(text, Contains("endTimeCode = 39"));
  CHECK_THAT(text, Contains("timeCodesPerSecond = 30"));
  const std::map<std::string, Prim> prims = parse_prims(text);
  REQUIRE(prims.count("Scene") == 1);
  REQUIRE(prims.count("static") == 1);
  REQUIRE(prims.count("moving") == 1);
  CHECK(prims.at("static").arrays.at("positions").size() == 1);
  CHECK(prims.at("static").arrays.at("opacities").count(-1) == 1);
  CHECK(prims.at("moving").arrays.at("positions").size() == 2);
  CHECK(prims.size() > 5);
  for (int frame = 0; frame < 40; ++frame) {
    const Result<Gaussians4D> snapshot = snapshot_at(scene, frame);
    REQUIRE(snapshot.ok());
    Gaussians4D expected = *snapshot;
    flip_axes(expected, 1, -1, -1);
    std::map<std::vector<float>, std::size_t> by_sh;  // the SH identify a primitive
    for (std::size_t i = 0; i < expected.size(); ++i) {
      by_sh[{expected.sh.begin() + 12 * static_cast<std::ptrdiff_t>(i),
             expected.sh.begin() + 12 * static_cast<std::ptrdiff_t>(i + 1)}] = i;
    }
    std::size_t found = 0;
    for (const auto& [name, prim] : prims) {
      if (name == "Scene" || !is_visible(prim, frame)) continue;
      const std::vector<double> positions = value_at(prim, "positions", frame),
                                opacities = value_at(prim, "opacities", frame),
                                sh = value_at(prim, "radiance:sphericalHarmonicsCoefficients",
                                              frame),
                                scales = value_at(prim, "scales", frame);
      for (std::size_t k = 0; k < opacities.size(); ++k) {
        const auto match = by_sh.find({sh.begin() + 12 * static_cast<std::ptrdiff_t>(k),
                                       sh.begin() + 12 * static_cast<std::ptrdiff_t>(k + 1)});
        if (match == by_sh.end()) {
          CHECK(opacities[k] == 0);
          continue;
        }
        const std::size_t i = match->second;
        ++found;
        const double opacity = 1 / (1 + std::exp(-expected.opacity_logit[i]));
        CHECK(opacities[k] == Approx(opacity).margin(0.5 / 255 + 1e-5));
        for (std::size_t c = 0; c < 3; ++c) {
          CHECK(positions[3 * k + c] == Approx(expected.position[3 * i + c]).margin(1e-3));
          CHECK(scales[3 * k + c] == Approx(std::exp(expected.log_scale[3 * i + c])));
        }
      }
    }
    CHECK(found == expected.size());
  }
  REQUIRE(notes.size() >= 3);
  CHECK_THAT(notes[0], Contains("hardly change"));
  CHECK_THAT(notes[1], Contains("error half-way between frames"));
  CHECK_THAT(notes.back(), Contains("the start camera"));
}

TEST_CASE("USD: primitives of a part are visible only while it is shown") {
  Scene scene = random_scene(20, 0, 10, 4);
  std::fill(scene.gaussians.radius.begin(), scene.gaussians.radius.end(), 50.0f);
  std::fill(scene.gaussians.opacity_logit.begin(), scene.gaussians.opacity_logit.end(), 1.0f);
  scene.parts = {{0, 4, 12}, {4, 10, 8}};
  const std::map<std::string, Prim> prims = parse_prims(write_text(scene));
  for (int frame = 0; frame < 10; ++frame) {
    std::size_t visible = 0;
    for (const auto& [name, prim] : prims) {
      if (name == "Scene" || !is_visible(prim, frame)) continue;
      for (const double opacity : value_at(prim, "opacities", frame)) visible += opacity > 0;
    }
    CHECK(visible == (frame < 4 ? 12 : 8));
  }
}

TEST_CASE("USD: primitives between frames are dropped with a note, invalid sets are rejected") {
  Scene scene = random_scene(3, 0, 10, 5);
  scene.gaussians.time = {2.5f, 3, 4};
  scene.gaussians.sigma = {0.01f, 1, 1};
  scene.gaussians.radius = {0.25f, 1, 1};
  scene.gaussians.opacity_logit = {1, 1, 1};
  ConversionNotes notes;
  write_text(scene, &notes);
  CHECK_THAT(notes.at(1), Contains("dropped 1 of 3 primitives that are visible only between"));
  scene.gaussians.position[4] = NAN;
  CHECK(write_usda(scene).status().code() == StatusCode::kUsage);
  Scene empty;
  CHECK(write_usda(empty).status().code() == StatusCode::kUsage);
  empty.metadata.frames = 1;
  CHECK(write_usda(empty).ok());
}

TEST_CASE("USD: the frames of a lifespan are found in a clip of any length") {
  Scene scene = random_scene(4, 0, 10, 6);
  Gaussians4D& set = scene.gaussians;
  scene.metadata.frames = 0xFFFFFFFF;
  std::fill(set.velocity.begin(), set.velocity.end(), 0.0f);
  // Just below the threshold, so that the widened support has all frames: stepping through them
  // would take minutes.
  const double dim = 1 / 255.0 * (1 - 2e-6);
  set.opacity_logit = {static_cast<float>(std::log(dim / (1 - dim))), 2, 2, 2};
  set.time = {2e9f, 4096, 100, 4e9f};
  set.radius = {4e9f, 0, 40.25f, 3};
  set.sigma = {1, 2.5f, 1e-3f, 0.5f};
  ConversionNotes notes;
  const std::string text = write_text(scene, &notes);
  CHECK_THAT(notes.at(0), Contains("error half-way"));
  CHECK_THAT(notes.at(1), Contains("dropped 1 of 4 primitives that are visible only between"));
  const std::map<std::string, Prim> prims = parse_prims(text.substr(0, text.find("fading_3999")));
  std::size_t of_100 = 0;
  for (const auto& [name, prim] : prims) {
    const auto opacities = prim.arrays.find("opacities");
    if (name == "Scene" || opacities == prim.arrays.end()) continue;
    for (const auto& [frame, values] : opacities->second) of_100 += frame < 200 && values[0] > 0;
  }
  CHECK(of_100 == 81);  // frames 60 to 140
}

TEST_CASE("USD: a text that could exceed the memory limit is refused") {
  Scene scene = random_scene(1, 0, 10, 7);
  scene.metadata.frames = 400'000'000;
  scene.gaussians.opacity_logit = {2};
  scene.gaussians.sigma = {2e8f};
  const Status status = write_usda(scene).status();
  CHECK(status.code() == StatusCode::kUnsupported);
  CHECK_THAT(status.message(), Contains("allow more memory"));
  scene.metadata.frames = 4000;
  scene.gaussians.sigma = {1000};
  CHECK(write_usda(scene, nullptr, 64 << 10).status().code() == StatusCode::kUnsupported);
  for (const int sh_degree : {0, 3}) {
    const Scene many = random_scene(300, sh_degree, 40, 8);
    const auto bytes = write_usda(many);
    REQUIRE(bytes.ok());
    CHECK(bytes->capacity() < 3 * bytes->size());
    CHECK(write_usda(many, nullptr, bytes->capacity()).ok());  // it never grew
    CHECK(write_usda(many, nullptr, bytes->capacity() - 1).status().code() ==
          StatusCode::kUnsupported);
  }
}
