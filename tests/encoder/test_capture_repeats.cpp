// SPDX-License-Identifier: Apache-2.0
// Captures cannot name one file often: the frames of each name are decoded and written.
#include "capture_fixture.h"
#include "catch.h"

namespace stgs::encoder::capture_test {
namespace {

TEST_CASE("a capture cannot name one file twice, under whatever path or link") {
  const TemporaryFolder folder;
  const auto refused = [&](const std::string& path) {
    const Status status = load(folder.path).status();
    INFO(status.message());
    CHECK(status.code() == StatusCode::kInvalidFile);
    CHECK(fails_with(status, {path, "was named before"}));
  };
  write_image(folder / "i/0.png", test_image(0, 0));
  fs::create_directory_symlink(".", folder / "i/again");
  fs::create_hard_link(folder / "i/0.png", folder / "i/1.png");
  for (const char* name : {"i/0.png", "./i/../i/0.png", "i/again/again/0.png", "i/1.png"}) {
    write_transforms(folder.path, {"i/0.png", name});
    refused("i/");
  }
  fs::remove(folder / "transforms.json");
  const std::string k = "[[60,0,32],[0,60,24],[0,0,1]]",
                    pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";
  const auto table = [&](const std::string& image, int camera) {
    return fmt::format(R"({{"w":64,"h":48,"fn":[["{}"]],"cam_id":[[{}]],"k":[[{}]],"w2c":[[{}]]}})",
                       image, camera, k, pose);
  };
  write_image(folder / "ims/0.png", test_image(0, 0));
  fs::create_directory_symlink(".", folder / "ims/again");
  write_text(folder / "train_meta.json", table("0.png", 0));
  write_text(folder / "test_meta.json", table("again/0.png", 1));
  refused("ims/again/0.png");
  fs::remove(folder / "train_meta.json");

  write_n3dv(folder.path, 3, 2);
  fs::remove(folder / "cam01.mp4");
  fs::create_symlink("cam00.mp4", folder / "cam01.mp4");
  refused("cam01.mp4");
}

TEST_CASE("the frames of two cameras of a prepared capture cannot be one folder") {
  const TemporaryFolder folder;
  PreparedCapture capture;
  capture.folder = folder.path;
  capture.files = files_of(folder);
  capture.frames = 1;
  capture.frame_extension = "png";
  capture.cameras.resize(2);
  for (int i = 0; i < 2; ++i) capture.cameras[i].name = fmt::format("c{}", i);
  write_image(folder / "frames/c0/000000.png", test_image(0, 0));
  fs::create_directory_symlink("c0", folder / "frames/c1");
  const Status status = check_frame_files(capture, capture.cameras);
  CHECK(fails_with(status, {"camera 'c1'", "frames/c1 was named before"}));
  CHECK(status.code() == StatusCode::kInvalidFile);
  CHECK(check_frame_files(capture, {capture.cameras[1]}).ok());
}

}  // namespace
}  // namespace stgs::encoder::capture_test
