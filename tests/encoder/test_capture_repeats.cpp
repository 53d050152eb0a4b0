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

TEST_CASE("links may repeat some frames of a folder, but not most of many") {
  const TemporaryFolder folder;
  const auto write_links = [&](const std::string& images, int frames) {
    for (int f = 2; f < frames; ++f) {
      const std::string link = fmt::format("{}/{:06}.png", images, f);
      if (f % 2 == 0)
        fs::create_symlink("000001.png", link);
      else
        fs::create_hard_link(images + "/000001.png", link);
    }
  };
  write_text(folder / "cameras.json",
             R"({"cam0":{"K":[60,0,32,0,60,24,0,0,1],"w2c":[1,0,0,0,0,1,0,0,0,0,1,0]},)"
             R"("cam1":{"K":[60,0,32,0,60,24,0,0,1],"w2c":[1,0,0,1,0,1,0,0,0,0,1,0]}})");
  const auto written = [&](int frames) {
    for (int c : {0, 1}) {
      const std::string images = fmt::format("{}/images/cam{}", folder.path, c);
      fs::remove_all(images);
      write_images(images, c, 2);
      write_links(images, frames);
    }
    return load(folder.path).status();
  };
  const Status few = written(19);
  INFO(few.message());
  CHECK(few.message().empty());
  const Status many = written(20);
  CHECK(many.code() == StatusCode::kInvalidFile);
  CHECK(fails_with(many, {folder.path, "40 frames are links to 4 images"}));

  PreparedCapture capture;
  capture.folder = folder / "prepared";
  capture.frames = 35;
  capture.frame_extension = "png";
  capture.cameras = {known_camera(0, 1, "a")};
  write_images(capture.folder + "/frames/a", 0, 2);
  write_links(capture.folder + "/frames/a", 35);
  auto files = CaptureFolder::open(capture.folder, false);
  REQUIRE(files.ok());
  capture.files = *files;
  CHECK(fails_with(check_frame_files(capture, capture.cameras),
                   {"prepared", "35 frames", "2 images"}));
  capture.frames = 34;
  CHECK(check_frame_files(capture, capture.cameras).ok());
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
