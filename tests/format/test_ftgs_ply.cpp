// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <fstream>

#include "catch.h"
#include "fixtures/ftgs_fixture.h"
#include "fixtures/temporary_folder.h"
#include "stgs/format/interchange_formats.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

Result<Scene> read_text(const std::string& text, const ClipSettings& settings = {},
                        ConversionNotes* notes = nullptr, const ReadLimits& limits = {}) {
  return read_ftgs_ply(*memory_source({text.begin(), text.end()}, "a.ftgs.ply"), settings, limits,
                       notes);
}

using Catch::Contains;

}  // namespace

TEST_CASE("FTGS PLY: times, durations and velocities become ticks") {
  const FtgsFile file = ftgs_file(4);
  ConversionNotes notes;
  const Result<Scene> scene = read_text(file.bytes(), {}, &notes);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  CHECK(notes.empty());
  CHECK(scene->metadata.frames == 61);
  CHECK(scene->metadata.time_base == TimeBase{1, 30});
  const Gaussians4D& set = scene->gaussians;
  REQUIRE(set.size() == 4);
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK(set.position[3 * i] == static_cast<float>(i));
    CHECK(set.log_scale[3 * i + 2] == -1);
    CHECK(set.opacity_logit[i] == 1.5f);
    CHECK(set.sh[3 * i + 1] == 0.25f);
    CHECK(set.time[i] == 15.0f * static_cast<float>(i));  // 60 intervals
    CHECK(set.sigma[i] == Approx(60 * 0.1 * std::sqrt(2.0)));
    CHECK(set.radius[i] == 0);
    CHECK(set.velocity[3 * i] == 0.1f);
    CHECK(set.velocity[3 * i + 1] == -0.05f);
  }
  // The opacity at frame 27 is that of the format's text.
  const double dt = 27 / 60.0 - 0.25;
  const double expected = std::exp(-0.5 * dt * dt / 0.01) / (1 + std::exp(-1.5));
  const Result<Gaussians4D> shown = snapshot_at(*scene, 27);
  REQUIRE(shown.ok());
  REQUIRE(shown->size() >= 2);
  std::size_t found = 0;
  for (std::size_t k = 0; k < shown->size(); ++k) {
    if (std::abs(shown->position[3 * k] - (1 + 6 * dt)) > 1e-4) continue;
    ++found;
    CHECK(1 / (1 + std::exp(-shown->opacity_logit[k])) == Approx(expected).epsilon(1e-4));
  }
  CHECK(found == 1);
}

TEST_CASE("FTGS PLY: the settings of the clip are followed") {
  FtgsFile file = ftgs_file(2);
  file.comments["use_velocity"] = "0";
  file.comments["min_duration"] = "0.5";
  file.comments["opacity_floor"] = "0.125";
  file.comments.erase("n_frames");
  ConversionNotes notes;
  Result<Scene> scene = read_text(file.bytes(), {}, &notes);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == 300);
  CHECK(scene->gaussians.sigma[0] == Approx(299 * 0.5 * std::sqrt(2.0)));
  CHECK(scene->gaussians.velocity[0] == 0);
  REQUIRE(notes.size() == 1);
  CHECK_THAT(notes[0], Contains("not to 0.125"));
  scene = read_text(file.bytes(), {11u, TimeBase{1, 24}});
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == 11);
  CHECK(scene->metadata.time_base == TimeBase{1, 24});
  CHECK(scene->gaussians.time[1] == 5);
  CHECK(read_text(file.bytes(), {0u, {}}).status().code() == StatusCode::kUsage);
  file.comments["n_frames"] = "61";
  CHECK(read_text(file.bytes(), {11u, {}}).status().code() == StatusCode::kUsage);
  file.comments["n_frames"] = "1";
  CHECK(read_text(file.bytes()).ok());
}

TEST_CASE("FTGS PLY: SH, and vertices that are not finite") {
  FtgsFile file = ftgs_file(3);
  file.rest = 9;
  file.comments["sh_degree"] = "1";
  for (auto& vertex : file.vertices) {
    for (int k = 8; k >= 0; --k) vertex.insert(vertex.begin() + 9, static_cast<float>(k));
  }
  file.vertices[1][9 + 9 + 9] = NAN;       // log_duration
  file.vertices[2][9 + 9 + 8] = INFINITY;  // time
  ConversionNotes notes;
  const Result<Scene> scene = read_text(file.bytes(), {}, &notes);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  REQUIRE(scene->gaussians.size() == 1);
  CHECK_THAT(notes.at(0), Contains("dropped 2 of 3"));
  // Coefficient 1 of red, green and blue.
  CHECK(scene->gaussians.sh[3] == 0);
  CHECK(scene->gaussians.sh[4] == 3);
  CHECK(scene->gaussians.sh[5] == 6);
  file.comments["sh_degree"] = "0";
  CHECK_THAT(read_text(file.bytes()).status().message(), Contains("SH of degree 0"));
}

TEST_CASE("FTGS PLY: invalid files are rejected") {
  const auto rejects = [](const char* key, const char* value, const char* message) {
    FtgsFile file = ftgs_file(1);
    file.comments[key] = value;
    INFO(key << " " << value);
    CHECK_THAT(read_text(file.bytes()).status().message(), Contains(message));
  };
  rejects("ftgs_version", "2", "unsupported FTGS version (expected 1, got '2')");
  rejects("time_units", "seconds", "got 'seconds'");
  rejects("sh_degree", "4", "comment sh_degree");
  rejects("sh_degree", "", "comment sh_degree");
  rejects("use_velocity", "0.5", "whole number");
  rejects("min_duration", "0", "comment min_duration");
  rejects("min_duration", "nan", "comment min_duration");
  rejects("opacity_floor", "-1", "comment opacity_floor");
  rejects("n_frames", "0", "comment n_frames");
  rejects("n_frames", "5000000000", "comment n_frames");
  rejects("n_frames", "12 frames", "comment n_frames");
  const std::string text = ftgs_file(2).bytes();
  const auto replaced = [&](const std::string& from, const std::string& to) {
    std::string out = text;
    return out.replace(out.find(from), from.size(), to);
  };
  CHECK_THAT(read_text(replaced("log_duration", "lag_duration")).status().message(),
             Contains("lack the property 'log_duration'"));
  CHECK_THAT(read_text(replaced("vertex 2", "vertex 4000000000")).status().message(),
             Contains("truncated"));
  CHECK_THAT(read_text(replaced("binary_little_endian", "ascii")).status().message(),
             Contains("use binary_little_endian"));
  ReadLimits limits;
  limits.max_primitives = 1;
  CHECK(read_text(text, {}, nullptr, limits).status().code() == StatusCode::kUnsupported);
  for (std::size_t length = 0; length < text.size(); ++length) {
    const StatusCode code = read_text(text.substr(0, length)).status().code();
    if (code != StatusCode::kInvalidFile && code != StatusCode::kUnsupported) {
      FAIL("length " << length << ": " << int(code));
    }
  }
}

TEST_CASE("FTGS PLY: the comments select the reader, not the name") {
  const TemporaryFolder folder;
  FtgsFile file = ftgs_file(1);
  std::ofstream(folder / "a.ply", std::ios::binary) << file.bytes();
  CHECK(std::string((*detect_format(folder / "a.ply"))->name) == "FTGS PLY");
  file.comments = {};
  std::ofstream(folder / "b.ftgs.ply", std::ios::binary) << file.bytes();
  CHECK(std::string((*detect_format(folder / "b.ftgs.ply"))->name) == "PLY");
}
