// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <fstream>

#include "catch.h"
#include "fixtures/temporary_folder.h"
#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {
namespace {

std::vector<InitialPoint> some_points(bool moving, bool with_normals = false) {
  std::vector<InitialPoint> points;
  for (int i = 0; i < 7; ++i) {
    const float f = static_cast<float>(i);
    InitialPoint p{
        {f, -f, 0.5f * f}, {static_cast<std::uint8_t>(i), 128, 255}, {0, 0, 0}, -1, {0, 0, 0}};
    if (moving) {
      p.frame = i;
      p.velocity[1] = 0.25f * f;
    }
    if (with_normals && i % 2 == 0) p.normal[i % 3] = i % 4 == 0 ? 1.0f : -1.0f;
    points.push_back(p);
  }
  return points;
}

TEST_CASE("initial points round-trip") {
  for (int kind = 0; kind < 4; ++kind) {
    const testing::TemporaryFolder folder;
    const std::string path = folder / "points.ply";
    const auto points = some_points(kind % 2 == 1, kind >= 2);
    REQUIRE(write_points(path, points).ok());
    const auto back = read_points(path);
    REQUIRE(back.ok());
    REQUIRE(back->size() == points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      for (int c = 0; c < 3; ++c) {
        CHECK((*back)[i].position[c] == points[i].position[c]);
        CHECK((*back)[i].colour[c] == points[i].colour[c]);
        CHECK((*back)[i].velocity[c] == points[i].velocity[c]);
        CHECK((*back)[i].normal[c] == points[i].normal[c]);
      }
      CHECK((*back)[i].frame == points[i].frame);
    }
    std::filesystem::remove(path);
  }
}

TEST_CASE("a points file whose count or properties do not match its bytes is rejected") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "points.ply";
  REQUIRE(write_points(path, some_points(true)).ok());
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 1);
  CHECK(read_points(path).status().code() == StatusCode::kInvalidFile);
  std::ofstream(path) << "ply\nformat binary_little_endian 1.0\nelement vertex "
                         "18446744073709551615\nproperty float x\nproperty float y\nproperty "
                         "float z\nproperty uchar red\nproperty uchar green\nproperty uchar "
                         "blue\nend_header\n";
  CHECK(read_points(path).status().code() == StatusCode::kInvalidFile);
  for (const char* wrong : {"property double x", "property list uchar float x", "comment"}) {
    std::ofstream(path) << "ply\nformat binary_little_endian 1.0\nelement vertex 0\n"
                        << wrong
                        << "\nproperty float y\nproperty float z\nproperty uchar red\n"
                           "property uchar green\nproperty uchar blue\nend_header\n";
    CHECK(read_points(path).status().code() == StatusCode::kInvalidFile);
  }
  std::ofstream(path) << "ply\nelement ver";
  CHECK(read_points(path).status().code() == StatusCode::kInvalidFile);
  std::filesystem::remove(path);
  CHECK(read_points(path).status().code() == StatusCode::kIo);
}

}  // namespace
}  // namespace stgs::encoder
