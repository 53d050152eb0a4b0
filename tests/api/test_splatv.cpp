// SPDX-License-Identifier: Apache-2.0
#include "catch.h"
#include "splatv_fixture.h"
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

// A coordinate of the primitive at a time of the file, 0 to 1.
double at(const Gaussians4D& set, std::size_t i, std::size_t axis, double t) {
  return set.position[3 * i + axis] + set.velocity[3 * i + axis] * (40 * t - set.time[i]);
}

}  // namespace

TEST_CASE("splatv: what moves straight and does not turn is taken over as it is") {
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
    // Its visibility is the same function of time.
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
  // Its own position is the origin of the camera.
  for (std::size_t row = 0; row < 3; ++row) {
    CHECK(camera.rotation[3 * row] * 1 + camera.rotation[3 * row + 1] * 2 +
              camera.rotation[3 * row + 2] * 3 + camera.translation[row] ==
          Approx(0).margin(1e-6));
  }
  // What it looks along, z, is the third column of its rotation to the world.
  CHECK(camera.rotation[6] == 1.0f);
}

TEST_CASE("splatv: a bent path becomes the straight one that is nearest, and the loss is told") {
  SplatvRecord r;
  r.motion = {0, 0, 0, 4, 0, 0, 0, 0, 0};  // x = 4 dt^2
  r.centre = 0.5f;
  r.width = 0.125f;
  SplatvRecord turning;
  turning.turning = {0, 1, 0, 0};
  SplatvReport report;
  ConversionNotes notes;
  const Result<Scene> scene = read(splatv_file({r, turning}), &report, &notes);
  REQUIRE(scene.ok());
  const Gaussians4D& set = scene->gaussians;
  // A parabola about its own centre: no velocity, and the mean of x over the visibility.
  CHECK(set.velocity[0] == Approx(0).margin(1e-6));
  CHECK(set.position[0] == Approx(4 * 0.125 * 0.125 / 2).epsilon(0.1));
  const double reach = 0.125 * std::sqrt(std::log(204.0));
  CHECK(report.path_max == Approx(4 * reach * reach - set.position[0]).epsilon(0.01));
  CHECK(report.bent == 1);
  CHECK(report.rotation_max > 10);
  CHECK(notes.size() == 2);
}

TEST_CASE("splatv: records that are never seen or are no numbers are left out") {
  SplatvRecord empty;
  empty.rgba = {0, 0, 0, 0};
  SplatvRecord late;
  late.centre = 3;
  SplatvRecord no_width;
  no_width.width = 0;
  SplatvRecord no_number;
  no_number.position[1] = NAN;
  SplatvRecord no_rotation;
  no_rotation.rotation = {0, 0, 0, 0};
  SplatvRecord no_motion;
  no_motion.motion[4] = NAN;
  SplatvRecord endless;
  endless.width = INFINITY;
  ConversionNotes notes;
  SplatvReport report;
  const Result<Scene> scene =
      read(splatv_file({empty, late, no_width, no_number, no_rotation, no_motion, endless, {}}),
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

TEST_CASE("splatv: what lies about itself is refused") {
  const std::vector<SplatvRecord> records(3);
  const std::string good = splatv_file(records);
  REQUIRE(read(good).ok());
  for (std::size_t length = 0; length < good.size(); ++length) {
    CHECK(read(good.substr(0, length)).status().code() == StatusCode::kInvalidFile);
  }
  std::string bad = good;
  bad[0] = 'X';
  CHECK_THAT(read(bad).status().message(), Contains("not a .splatv file"));
  bad = good;
  bad[7] = 127;
  CHECK_THAT(read(bad).status().message(), Contains("JSON of"));
  const auto refused = [&](const nlohmann::json& json) {
    const Result<Scene> scene = read(splatv_file(records, json.dump()));
    CHECK_FALSE(scene.ok());
    return scene.status().message();
  };
  nlohmann::json chunks = splatv_chunks(3);
  chunks[0]["size"] = std::uint64_t{1} << 62;
  CHECK_THAT(refused(chunks), Contains("the file is truncated"));
  chunks = splatv_chunks(3);
  chunks[0]["size"] = -64;
  CHECK_THAT(refused(chunks), Contains("without a size"));
  chunks = splatv_chunks(3);
  chunks[0]["texheight"] = 4;
  CHECK_THAT(refused(chunks), Contains("do not match"));
  chunks[0]["texwidth"] = 0;
  CHECK_THAT(refused(chunks), Contains("do not match"));
  chunks = splatv_chunks(3);
  chunks[0]["type"] = "other";
  CHECK_THAT(refused(chunks), Contains("no chunk of type"));
  CHECK_THAT(refused({{"type", "splat"}}), Contains("not a list"));
  CHECK_THAT(refused({1, 2}), Contains("without a size"));
  CHECK_THAT(read(splatv_file(records, "[{")).status().message(), Contains("not valid JSON"));
  ReadLimits limits;
  limits.max_primitives = 2;
  CHECK(read(good, nullptr, nullptr, limits).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("splatv: a camera that is none is no start camera") {
  nlohmann::json chunks = splatv_chunks(1);
  chunks[0]["cameras"][0]["rotation"][0][0] = 5;
  const Result<Scene> scene = read(splatv_file({SplatvRecord{}}, chunks.dump()));
  REQUIRE(scene.ok());
  CHECK_FALSE(scene->metadata.start_camera);
}
