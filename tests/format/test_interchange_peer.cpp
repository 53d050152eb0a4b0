// SPDX-License-Identifier: Apache-2.0
// Files written by other programs (tests/data/interchange/README.md).
#include "stgs/format/interchange_formats.h"

#include "catch.h"

namespace stgs {
namespace {

Gaussians4D read(const std::string& name) {
  const std::string path = STGS_TEST_DATA "/interchange/" + name;
  const Result<const InterchangeFormat*> format = detect_format(path);
  REQUIRE(format.ok());
  REQUIRE(*format != nullptr);
  ImportReport found;
  Result<Scene> scene = read_interchange(**format, path, {}, {}, found);
  REQUIRE(scene.ok());
  CHECK(found.notes.empty());
  return std::move(scene->gaussians);
}

}  // namespace

TEST_CASE("SPZ files of the reference library decode to their source, axes and SH included") {
  const Gaussians4D source = read("source.ply");
  CHECK(source.size() == 12);
  CHECK(source.sh_degree == 3);
  for (const char* name : {"version3.spz", "version4.spz"}) {
    const auto errors = conversion_errors(source, static_scene(read(name)));
    REQUIRE(errors.ok());
    CHECK(errors->position_max <= 0.87 / 4096);
    CHECK(errors->log_scale_max <= 0.5 / 16 + 1e-5);
    CHECK(errors->rotation_max < 0.3);
    CHECK(errors->opacity_max <= 0.5 / 255 + 1e-6);
    CHECK(errors->colour_max < 0.004);
    CHECK(errors->sh_max <= 0.0625 + 0.5 / 128);  // rounded twice
  }
}

TEST_CASE("packed PLY decodes to the output of its reference program") {
  const auto errors = conversion_errors(read("unpacked.ply"), static_scene(read("packed.ply")));
  REQUIRE(errors.ok());
  CHECK(errors->position_max < 1e-6);
  CHECK(errors->log_scale_max < 2e-6);
  CHECK(errors->rotation_max < 1e-3);
  CHECK(errors->opacity_max < 1e-6);
  CHECK(errors->colour_max < 1e-6);
  CHECK(errors->sh_max < 1e-6);
}

}  // namespace stgs
