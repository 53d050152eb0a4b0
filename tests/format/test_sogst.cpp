// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstring>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "fixtures/sogst_fixture.h"
#include "fixtures/temporary_folder.h"
#include "fixtures/truncated_archive.h"
#include "stgs/format/interchange_formats.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

Result<Scene> read_model(const SogModel& model, const CurveSettings& settings = {},
                         CurveReport* report = nullptr, ConversionNotes* notes = nullptr,
                         const ReadLimits& limits = {}) {
  const TemporaryFolder folder;
  model.write_bundle(folder / "a.sogst");
  return read_sogst(folder / "a.sogst", settings, limits, report, notes);
}

Status read_error(const SogModel& model, const ReadLimits& limits = {}) {
  const Result<Scene> scene = read_model(model, {}, nullptr, nullptr, limits);
  CHECK_FALSE(scene.ok());
  return scene.status();
}

int byte_of(const SogModel& model, const char* name, std::size_t i, std::size_t c) {
  return model.images.at(name).rgba[4 * i + c];
}

// A value of two images between bounds, as section 2.2 of the format's text decodes it.
double split_value(const SogModel& model, const char* property, std::size_t i, std::size_t c) {
  const nlohmann::json& p = model.meta[property];
  const std::string low = p["files"][0], high = p["files"][1];
  const double q =
      (byte_of(model, high.c_str(), i, c) * 256 + byte_of(model, low.c_str(), i, c)) / 65535.0;
  const double min = p["mins"][c], max = p["maxs"][c], t = min + q * (max - min);
  return t < 0 ? 1 - std::exp(-t) : std::exp(t) - 1;
}

// The state of a splat at a time in seconds, by section 1 of the format's text.
struct State {
  double position[3], opacity;
};
State truth_at(const SogModel& model, std::size_t i, double seconds) {
  const nlohmann::json& lifespans = model.meta["trbf"];
  const double centre = lifespans["center"]["codebook"][byte_of(model, "trbf.webp", i, 0)];
  const double deviation = lifespans["sigma"]["codebook"][byte_of(model, "trbf.webp", i, 1)];
  const double dt = seconds - centre;
  State state;
  for (std::size_t c = 0; c < 3; ++c) {
    state.position[c] = split_value(model, "means", i, c) + split_value(model, "motion", i, c) * dt;
    if (model.meta.contains("accel")) {
      state.position[c] += split_value(model, "accel", i, c) * dt * dt;
    }
  }
  state.opacity =
      byte_of(model, "sh0.webp", i, 3) / 255.0 * std::exp(-0.5 * dt * dt / (deviation * deviation));
  return state;
}
using Catch::Contains;

}  // namespace

TEST_CASE("sogst: linear motion and lifespans are exact") {
  const SogModel model = random_sogst(24, 2, 1, 3);
  ConversionNotes notes;
  CurveReport report;
  const Result<Scene> scene = read_model(model, {}, &report, &notes);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  CHECK(notes.empty());
  CHECK(scene->metadata.frames == 20);
  CHECK(scene->metadata.time_base == TimeBase{1, 10});
  CHECK(report.primitives == 24);
  CHECK(report.curved == 0);
  const Gaussians4D& set = scene->gaussians;
  REQUIRE(set.size() == 24);
  CHECK(set.sh_degree == 2);
  for (std::size_t i = 0; i < 24; ++i) {
    const double centre = 3.0 * byte_of(model, "trbf.webp", i, 0) / 255;
    const double deviation = 0.05 + 0.95 * byte_of(model, "trbf.webp", i, 1) / 255;
    CHECK(set.time[i] == Approx((centre - 0.5) * 10).margin(1e-5));
    CHECK(set.sigma[i] == Approx(deviation * std::sqrt(2.0) * 10));
    CHECK(set.radius[i] == 0);
    for (std::size_t c = 0; c < 3; ++c) {
      CHECK(set.position[3 * i + c] == Approx(split_value(model, "means", i, c)).margin(1e-6));
      CHECK(set.velocity[3 * i + c] ==
            Approx(split_value(model, "motion", i, c) / 10).margin(1e-7));
    }
  }
}

TEST_CASE("sogst: pieces of curved paths stay within the bounds at every time") {
  const double bounds[] = {0.02, 0.1, 1};
  std::uint64_t pieces_before = UINT64_MAX;
  for (const double position : bounds) {
    const SogModel model = random_sogst(60, 0, 2, 11);
    const CurveSettings settings{position, 0.02};
    CurveReport report;
    ConversionNotes notes;
    const Result<Scene> scene = read_model(model, settings, &report, &notes);
    INFO(scene.status().message() << " bound " << position);
    REQUIRE(scene.ok());
    CHECK(report.primitives == 60);
    CHECK(report.curved == 60);
    CHECK(report.divided > 0);
    CHECK(scene->gaussians.size() == 60 - report.divided + report.pieces);
    CHECK(report.pieces <= pieces_before);
    pieces_before = report.pieces;
    CHECK(report.opacity_max <= 0.02 + 1e-9);
    REQUIRE(notes.size() >= 2);
    CHECK_THAT(notes[0], Contains("approximated 60 curved paths by lines"));
    CHECK_THAT(notes[1], Contains("divided"));
  }
}

TEST_CASE("sogst: the reported errors of divided paths are those of the primitives") {
  SogModel model = random_sogst(1, 0, 2, 7, 1, 1);
  model.meta["trbf"]["sigma"]["codebook"] = codebook_of(0.3, 0.3);
  model.images["scales.webp"].rgba = {200, 200, 200, 255};  // e^-1.55
  model.images["sh0.webp"].rgba = {100, 100, 100, 230};
  model.images["trbf.webp"].rgba = {120, 0, 0, 255};
  model.images["accel_l.webp"].rgba = {255, 0, 128, 255};
  model.images["accel_u.webp"].rgba = {255, 0, 200, 255};
  for (const double bound : {0.01, 0.1, 0.4}) {
    CurveReport report;
    const Result<Scene> scene = read_model(model, {bound, 0.02}, &report);
    REQUIRE(scene.ok());
    const Gaussians4D& set = scene->gaussians;
    INFO("bound " << bound << ", pieces " << set.size());
    REQUIRE(report.divided == 1);
    CHECK(report.pieces == set.size());
    CHECK(report.above_bound == 0);
    CHECK(report.position_relative_max <= bound);
    CHECK(report.position_max ==
          Approx(report.position_relative_max * std::exp(-9 + 9.5 * 200 / 255.0)).epsilon(1e-4));
    double farthest = 0, fade = 0;
    for (double ticks = 0; ticks <= 20; ticks += 1.0 / 64) {
      const Result<Gaussians4D> shown = snapshot_at(*scene, ticks);
      REQUIRE(shown.ok());
      const State truth = truth_at(model, 0, 0.5 + ticks / 10);
      const bool at_frame = ticks == std::floor(ticks);
      if (at_frame) {
        const double opacity =
            shown->size() == 0 ? 0 : 1 / (1 + std::exp(-shown->opacity_logit[0]));
        CHECK(shown->size() <= 1);  // no two pieces at a frame
        if (truth.opacity >= 1.01 / 255) CHECK(shown->size() == 1);
        if (shown->size() == 1) fade = std::max(fade, std::abs(opacity - truth.opacity));
      }
      for (std::size_t k = 0; k < shown->size(); ++k) {
        double square = 0;
        for (std::size_t c = 0; c < 3; ++c) {
          square += std::pow(shown->position[3 * k + c] - truth.position[c], 2);
        }
        farthest = std::max(farthest, std::sqrt(square));
      }
    }
    CHECK(farthest <= report.position_max + 1e-5);
    CHECK(farthest >= 0.5 * report.position_max);
    CHECK(fade <= report.opacity_max + 1e-5);
  }
}

TEST_CASE("sogst: a path that one line describes keeps its lifespan") {
  SogModel model = random_sogst(20, 0, 2, 5, 1e-4);
  model.images["scales.webp"].rgba.assign(model.images["scales.webp"].rgba.size(), 230);
  CurveReport report;
  const Result<Scene> scene = read_model(model, {}, &report);
  REQUIRE(scene.ok());
  CHECK(scene->gaussians.size() == 20);
  CHECK(report.curved == 20);
  CHECK(report.divided == 0);
  CHECK(report.opacity_max == 0);
  CHECK(report.position_max > 0);
  for (std::size_t i = 0; i < 20; ++i) {
    CHECK(scene->gaussians.radius[i] == 0);
    const double deviation = 0.05 + 0.95 * byte_of(model, "trbf.webp", i, 1) / 255;
    CHECK(scene->gaussians.sigma[i] == Approx(deviation * std::sqrt(2.0) * 10));
    const State truth = truth_at(model, i, 1.5);
    if (truth.opacity < 1 / 255.0) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const double x = scene->gaussians.position[3 * i + c] +
                       scene->gaussians.velocity[3 * i + c] * (10 - scene->gaussians.time[i]);
      CHECK(x == Approx(truth.position[c]).margin(1e-5 + report.position_max));
    }
  }
}

TEST_CASE("sogst: an acceleration beyond any bound is reported") {
  const SogModel model = random_sogst(10, 0, 2, 5, 20);  // up to 5e8 units per square second
  CurveReport report;
  ConversionNotes notes;
  const Result<Scene> scene = read_model(model, {}, &report, &notes);
  REQUIRE(scene.ok());
  CHECK(report.above_bound > 0);
  CHECK(report.pieces <= 10 * 4096);
  CHECK(report.position_relative_max > 0.1);
  CHECK_THAT(notes.back(), Contains("exceed the bound of the position"));
  ReadLimits limits;
  limits.max_primitives = 20;
  CHECK_THAT(read_error(model, limits).message(), Contains("after the division of curved paths"));
}

TEST_CASE("sogst: the streamed layout has the same primitives") {
  const SogModel model = random_sogst(31, 1, 2, 9);
  const Result<Scene> plain = read_model(model), in_groups = read_model(streamed(model));
  INFO(plain.status().message() << in_groups.status().message());
  REQUIRE(plain.ok());
  REQUIRE(in_groups.ok());
  CHECK(fingerprints(plain->gaussians) == fingerprints(in_groups->gaussians));

  SogModel invalid = streamed(model);
  invalid.meta["segments"]["list"][1]["range"] = {10, 21};
  CHECK_THAT(read_error(invalid).message(), Contains("segments.list[2].range"));
  invalid = streamed(model);
  invalid.meta["segments"]["list"][2]["range"] = {20, 4'000'000'000};
  CHECK(read_error(invalid).code() == StatusCode::kInvalidFile);
  invalid = streamed(model);
  invalid.meta["segments"]["list"][2]["range"] = {20, 30};
  CHECK_THAT(read_error(invalid).message(), Contains("30 of 31 splats"));
  invalid = streamed(model);
  invalid.meta["streams"]["segments"][2] = nullptr;
  CHECK_THAT(read_error(invalid).message(), Contains("no images in streams"));
  invalid.meta["streams"]["segments"] = {1};
  CHECK(read_error(invalid).code() == StatusCode::kInvalidFile);
}

TEST_CASE("sogst: a screen-space footprint is reported") {
  SogModel model = random_sogst(4, 0, 1, 1);
  model.meta["cov2d_scale"] = {1.25, 1.0};
  ConversionNotes notes;
  REQUIRE(read_model(model, {}, nullptr, &notes).ok());
  REQUIRE(notes.size() == 1);
  CHECK_THAT(notes[0], Contains("1.25 x 1 times"));
}

TEST_CASE("sogst: inconsistent metadata is rejected") {
  const SogModel valid = random_sogst(20, 1, 2, 6);
  const auto rejects = [&](const char* pointer, const nlohmann::json& value, const char* message) {
    SogModel invalid = valid;
    invalid.meta[nlohmann::json::json_pointer(pointer)] = value;
    INFO(pointer << " " << value);
    const Status status = read_error(invalid);
    CHECK_THAT(status.message(), Contains(message));
    CHECK((status.code() == StatusCode::kInvalidFile || status.code() == StatusCode::kUnsupported));
  };
  rejects("/version", 2, "unsupported .sogst version (expected 1, got 2)");
  rejects("/version", "1", "expected 1, got \"1\"");
  rejects("/format", "sog", "format is \"sog\"");
  rejects("/count", 1e9, "count");
  rejects("/count", 4'000'000'000'000, "too many splats");
  rejects("/motion/degree", 3, "motion.degree");
  rejects("/motion/degree", 1, "accel is present");
  rejects("/accel", nullptr, "accel is missing");
  rejects("/motion/mins", {0, 0}, "motion.mins");
  rejects("/motion/maxs/0", 200, "motion.maxs[0] exceed");
  rejects("/accel/maxs/2", 1e30, "accel.maxs[2] exceed");
  rejects("/trbf/sigma/codebook/3", "x", "trbf.sigma.codebook[3]");
  rejects("/trbf/sigma/codebook", codebook_of(-1, 0), "expected a number > 0");
  rejects("/trbf/center/codebook", codebook_of(0, 1, 255), "trbf.center.codebook");
  rejects("/time/fps", 0, "time.fps");
  rejects("/time/fps", nullptr, "time.fps");
  rejects("/time/max", 0, "before time.min");
  rejects("/time/max", 1e9, "too many frames");
  rejects("/cov2d_scale", {1}, "cov2d_scale");
  rejects("/streams", {{"persistent", "p"}}, "segments.list");
  rejects("/trbf/files", {"absent.webp"}, "not found in the archive");
  SogModel small = valid;
  small.images["trbf.webp"] = random_sog(20, 0, 1, 10).images["sh0.webp"];
  CHECK_THAT(read_error(small).message(), Contains("image size differs"));
}

TEST_CASE("sogst: content selects the reader of an archive") {
  const TemporaryFolder folder;
  random_sogst(5, 0, 1, 1).write_bundle(folder / "a.sog");
  random_tsog(5, 0, 1).write_bundle(folder / "b.zip");
  random_sog(5, 0, 1).write_bundle(folder / "c.sogst");
  std::ofstream(folder / "d.sogst", std::ios::binary) << "PK\x03\x04";
  const auto name = [&](const char* file) {
    return std::string((*detect_format(folder / file))->name);
  };
  CHECK(name("a.sog") == "sogst");
  CHECK(name("b.zip") == "tsog");
  // Its meta.json takes more memory than that.
  const ReadLimits little{1, 1000};
  CHECK(std::string((*detect_format(folder / "b.zip", little))->name) == "SOG");
  CHECK(name("c.sogst") == "SOG");
  CHECK(name("d.sogst") == "sogst");
}

TEST_CASE("sogst: a truncated archive is rejected at every byte") {
  check_truncations(random_sogst(3, 0, 2, 9, 1, 2), "a.sogst",
                    [](const std::string& path) { return read_sogst(path).status(); });
}
