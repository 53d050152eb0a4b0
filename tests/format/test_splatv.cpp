// SPDX-License-Identifier: Apache-2.0
#include "catch.h"
#include "fixtures/splatv_fixture.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/splatv.h"

using namespace stgs;
using Catch::Contains;
using stgs::testing::splatv_chunks;
using stgs::testing::splatv_file;
using stgs::testing::SplatvRecord;

namespace {

Result<Scene> read(const std::string& bytes, SplatvReport* report = nullptr,
                   ConversionNotes* notes = nullptr, const ReadLimits& limits = {}) {
  SplatvSettings settings;
  settings.frames = 40;
  settings.frame_time = {1, 20};
  const auto source = memory_source({bytes.begin(), bytes.end()}, "clip.splatv");
  return read_splatv(*source, settings, limits, report, notes);
}

// A coordinate of primitive i at time t of the file, 0 to 1.
double at(const Gaussians4D& set, std::size_t i, std::size_t axis, double t) {
  return set.position[3 * i + axis] + set.velocity[3 * i + axis] * (40 * t - set.time[i]);
}

}  // namespace

TEST_CASE("splatv: linear motion without rotation is converted exactly") {
  SplatvRecord r;
  r.position = {1.5f, -2, 3};
  r.rotation = {0.5f, -0.5f, 0.5f, 0.5f};
  r.motion = {2, -1, 0.5f, 0, 0, 0, 0, 0, 0};
  r.centre = 0.25f;
  SplatvReport report;
  ConversionNotes notes;
  const Result<Scene> scene = read(splatv_file({r, SplatvRecord{}}), &report, &notes);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  const Gaussians4D& set = scene->gaussians;
  REQUIRE(set.size() == 2);
  CHECK(scene->metadata.frames == 40);
  CHECK(scene->metadata.time_base == TimeBase{1, 20});
  for (double t : {0.0, 0.25, 0.9}) {
    CHECK(at(set, 0, 0, t) == Approx(1.5 + 2 * (t - 0.25)));
    CHECK(at(set, 0, 1, t) == Approx(-2 - (t - 0.25)));
    CHECK(at(set, 0, 2, t) == Approx(3 + 0.5 * (t - 0.25)));
    // The visibility is the same function of time.
    const double x = (t - 0.25) / 0.25;
    CHECK(math::visibility(static_cast<float>(40 * t) - set.time[0], set.sigma[0], set.radius[0]) ==
          Approx(std::exp(-x * x)));
  }
  CHECK(set.log_scale[0] == Approx(std::log(0.25)));
  CHECK(set.log_scale[2] == Approx(std::log(0.0625)));
  CHECK(set.rotation[1] == Approx(-0.5));
  CHECK(1 / (1 + std::exp(-set.opacity_logit[0])) == Approx(204 / 255.0));
  CHECK(0.5 + 0.28209479 * set.sh[0] == Approx(1.0));
  CHECK(0.5 + 0.28209479 * set.sh[1] == Approx(128 / 255.0));
  CHECK(report.primitives == 2);
  CHECK(report.bent == 0);
  CHECK(report.path_max == Approx(0).margin(1e-12));
  CHECK(report.rotation_max == Approx(0).margin(1e-4));
  REQUIRE(scene->metadata.start_camera);
  const StartCamera& camera = *scene->metadata.start_camera;
  CHECK(camera.fy == 510);
  // The camera's position maps to the origin of camera space.
  for (std::size_t row = 0; row < 3; ++row) {
    CHECK(camera.rotation[3 * row] * 1 + camera.rotation[3 * row + 1] * 2 +
              camera.rotation[3 * row + 2] * 3 + camera.translation[row] ==
          Approx(0).margin(1e-6));
  }
  // The viewing direction z is the third column of the camera-to-world rotation.
  CHECK(camera.rotation[6] == 1.0f);
}

TEST_CASE("splatv: a curved path becomes the closest straight one, and the error is reported") {
  SplatvRecord r;
  r.motion = {0, 0, 0, 4, 0, 0, 0, 0, 0};  // x = 4 dt^2
  r.centre = 0.5f;
  r.width = 0.125f;
  SplatvRecord rotating;
  rotating.rotation_motion = {0, 1, 0, 0};
  SplatvReport report;
  ConversionNotes notes;
  const Result<Scene> scene = read(splatv_file({r, rotating}), &report, &notes);
  REQUIRE(scene.ok());
  const Gaussians4D& set = scene->gaussians;
  // A parabola around its centre: velocity 0 and the mean of x weighted by visibility.
  CHECK(set.velocity[0] == Approx(0).margin(1e-6));
  CHECK(set.position[0] == Approx(4 * 0.125 * 0.125 / 2).epsilon(0.1));
  const double reach = 0.125 * std::sqrt(std::log(204.0));
  CHECK(report.path_max == Approx(4 * reach * reach - set.position[0]).epsilon(0.01));
  CHECK(report.bent == 1);
  CHECK(report.rotation_max > 10);
  CHECK(notes.size() == 2);
}

TEST_CASE("splatv: records that are never visible or not finite are dropped") {
  SplatvRecord empty;
  empty.rgba = {0, 0, 0, 0};
  SplatvRecord after_end;
  after_end.centre = 3;
  SplatvRecord no_width;
  no_width.width = 0;
  SplatvRecord not_finite;
  not_finite.position[1] = NAN;
  SplatvRecord no_rotation;
  no_rotation.rotation = {0, 0, 0, 0};
  SplatvRecord no_motion;
  no_motion.motion[4] = NAN;
  SplatvRecord unbounded;
  unbounded.width = INFINITY;
  ConversionNotes notes;
  SplatvReport report;
  const Result<Scene> scene = read(
      splatv_file({empty, after_end, no_width, not_finite, no_rotation, no_motion, unbounded, {}}),
      &report, &notes);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  CHECK(scene->gaussians.size() == 2);
  CHECK(report.primitives == 2);
  CHECK(std::isfinite(scene->gaussians.sigma[0]));
  REQUIRE(notes.size() == 2);
  CHECK_THAT(notes[0], Contains("3 of 5"));
  CHECK_THAT(notes[1], Contains("2 of 7"));
}

TEST_CASE("splatv: files that contradict themselves are rejected") {
  const std::vector<SplatvRecord> records(3);
  const std::string valid = splatv_file(records);
  REQUIRE(read(valid).ok());
  for (std::size_t length = 0; length < valid.size(); ++length) {
    CHECK(read(valid.substr(0, length)).status().code() == StatusCode::kInvalidFile);
  }
  std::string invalid = valid;
  invalid[0] = 'X';
  CHECK_THAT(read(invalid).status().message(), Contains("not a .splatv file"));
  invalid = valid;
  invalid[7] = 127;
  CHECK_THAT(read(invalid).status().message(), Contains("JSON of"));
  const auto rejection = [&](const nlohmann::json& json) {
    const Result<Scene> scene = read(splatv_file(records, json.dump()));
    CHECK_FALSE(scene.ok());
    return scene.status().message();
  };
  nlohmann::json chunks = splatv_chunks(3);
  chunks[0]["size"] = std::uint64_t{1} << 62;
  CHECK_THAT(rejection(chunks), Contains("the file is truncated"));
  chunks = splatv_chunks(3);
  chunks[0]["size"] = -64;
  CHECK_THAT(rejection(chunks), Contains("without a size"));
  chunks = splatv_chunks(3);
  chunks[0]["texheight"] = 4;
  CHECK_THAT(rejection(chunks), Contains("do not match"));
  chunks[0]["texwidth"] = 0;
  CHECK_THAT(rejection(chunks), Contains("do not match"));
  chunks = splatv_chunks(3);
  chunks[0]["type"] = "other";
  CHECK_THAT(rejection(chunks), Contains("no chunk of type"));
  CHECK_THAT(rejection({{"type", "splat"}}), Contains("not a list"));
  CHECK_THAT(rejection({1, 2}), Contains("without a size"));
  CHECK_THAT(read(splatv_file(records, "[{")).status().message(), Contains("not valid JSON"));
  ReadLimits limits;
  limits.max_primitives = 2;
  CHECK(read(valid, nullptr, nullptr, limits).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("splatv: an invalid camera is not used as the start camera") {
  nlohmann::json chunks = splatv_chunks(1);
  chunks[0]["cameras"][0]["rotation"][0][0] = 5;
  const Result<Scene> scene = read(splatv_file({SplatvRecord{}}, chunks.dump()));
  REQUIRE(scene.ok());
  CHECK_FALSE(scene->metadata.start_camera);
}
