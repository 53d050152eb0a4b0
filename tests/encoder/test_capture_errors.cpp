// SPDX-License-Identifier: Apache-2.0
// Incomplete, misnamed or damaged captures are rejected by name, never adapted.
#include <algorithm>

#include "capture_fixture.h"
#include "catch.h"
#include "src/capture/capture_files.h"

namespace stgs::encoder::capture_test {
namespace {

// Cameras a, b, c: folders of images and cameras.json; `lens` is added to each camera's JSON.
void write_abc(const TemporaryFolder& folder, int frames, const std::string& lens = "") {
  std::string list;
  for (int i = 0; i < 3; ++i) {
    const Camera c = known_camera(i, 3, "");
    const std::string name(1, static_cast<char>('a' + i));
    list += fmt::format("{}\"{}\":{{\"K\":{},\"w2c\":{}{}}}", i == 0 ? "" : ",", name,
                        json_list(matrix_k(c)), json_list(world_to_camera(c)), lens);
    write_images(folder / ("images/" + name), i, frames);
  }
  write_text(folder / "cameras.json", "{" + list + "}");
}

// Status of loading and planning the capture, before any frame is written.
Status planned(const std::string& folder, const PrepareSettings& settings = {}) {
  STGS_ASSIGN(const SourceCapture source, load(folder, settings));
  PreparedCapture prepared;
  return plan_frames(source, settings, prepared,
                     [](int, const std::string& line) { log_lines().push_back(line); })
      .status();
}

Status load_and_write(const std::string& folder, const PrepareSettings& settings,
                      const std::string& out) {
  STGS_ASSIGN(const SourceCapture source, load(folder, settings));
  PreparedCapture prepared;
  prepared.folder = out;
  const auto log = [](int, const std::string&) {};
  STGS_ASSIGN(const auto plans, plan_frames(source, settings, prepared, log));
  OpenVideos videos;
  return write_frames(source, plans, prepared, videos, {});
}

TEST_CASE("a gap in the numbered images is named, even if all cameras have the same number") {
  const TemporaryFolder folder;
  write_abc(folder, 6);
  fs::remove(folder / "images/c/000005.png");
  fs::remove(folder / "images/a/000001.png");
  fs::remove(folder / "images/b/000004.png");
  CHECK(fails_with(planned(folder.path), {"images/a", "camera 'a'", "frame 1 "}));
  write_image(folder / "images/a/000001.png", test_image(0, 1));
  CHECK(fails_with(planned(folder.path), {"images/b", "camera 'b'", "frame 4 "}));
  PrepareSettings before;
  before.end_frame = 4;
  CHECK(planned(folder.path, before).ok());
  before.end_frame = 5;
  CHECK(fails_with(planned(folder.path, before), {"camera 'b'", "frame 4 "}));
}

TEST_CASE("cameras whose images begin with different frames are rejected") {
  const TemporaryFolder folder;
  write_abc(folder, 4);
  fs::remove(folder / "images/b/000000.png");
  for (const char* name : {"a", "c"})
    fs::remove(folder / fmt::format("images/{}/000003.png", name));
  CHECK(fails_with(planned(folder.path), {"images/b", "camera 'b'", "frame 0 "}));
}

TEST_CASE("images may be numbered from any frame in any step, or be unnumbered") {
  const TemporaryFolder folder;
  write_abc(folder, 6);
  for (const char* name : {"a", "b", "c"}) {
    for (int frame : {0, 2, 4})
      fs::remove(folder / fmt::format("images/{}/{:06}.png", name, frame));
  }
  CHECK(planned(folder.path).ok());  // 1, 3, 5
  for (const char* name : {"a", "b", "c"}) {
    int letter = 'x';
    for (int frame : {1, 3, 5}) {
      fs::rename(folder / fmt::format("images/{}/{:06}.png", name, frame),
                 folder / fmt::format("images/{}/{}.png", name, static_cast<char>(letter++)));
    }
  }
  CHECK(planned(folder.path).ok());
  const auto lines = log_lines();
  CHECK(std::any_of(lines.begin(), lines.end(), [](const std::string& line) {
    return line.find("no frame number") != std::string::npos;
  }));
  write_image(folder / "images/b/9.png", test_image(1, 0));
  CHECK(fails_with(planned(folder.path), {"images/b", "one way"}));
}

TEST_CASE("two files for the same frame are rejected") {
  const TemporaryFolder folder;
  write_abc(folder, 3);
  write_image(folder / "images/b/000001.jpg", test_image(1, 1));
  CHECK(fails_with(planned(folder.path), {"images/b/000001", "camera 'b'", "one file per frame"}));
}

TEST_CASE("masks next to a capture are used in every layout") {
  const TemporaryFolder folder;
  write_n3dv(folder.path, 3, 3);
  write_images(folder / "masks/cam01", 1, 3);
  auto capture = load(folder.path);
  REQUIRE(capture.ok());
  REQUIRE(find(*capture, "cam01")->masks.size() == 3);
  CHECK(find(*capture, "cam00")->masks.empty());

  SECTION("a gap is reported as a missing mask") {
    fs::remove(folder / "masks/cam01/000001.png");
    CHECK(fails_with(load(folder.path).status(), {"masks/cam01", "'cam01'", "mask of frame 1 "}));
  }
  SECTION("a mask folder that matches no camera is logged") {
    write_images(folder / "masks/cam1", 1, 3);
    REQUIRE(load(folder.path).ok());
    bool logged = false;
    for (const std::string& line : log_lines()) logged |= line.find("'cam1'") != std::string::npos;
    CHECK(logged);
  }
  SECTION("mask folders that match no camera at all are an error") {
    fs::rename(folder / "masks/cam01", folder / "masks/cam1");
    CHECK(fails_with(load(folder.path).status(), {"/masks", "cam00", "any camera"}));
  }
}

TEST_CASE("nerfstudio's masks/ are motion masks unless transforms.json refers to them") {
  const TemporaryFolder folder;
  const Camera c = known_camera(0, 3, "");
  std::vector<double> c2w(16, 0.0);
  c2w[0] = c2w[5] = c2w[10] = c2w[15] = 1;
  const auto write = [&](const std::string& more) {
    std::string frames;
    for (int f = 0; f < 2; ++f) {
      frames +=
          fmt::format("{}{{\"file_path\":\"images/one/{:06}.png\",\"transform_matrix\":{}{}}}",
                      f == 0 ? "" : ",", f, json_list(c2w), more);
    }
    write_text(folder / "transforms.json",
               fmt::format("{{\"w\":{},\"h\":{},\"fl_x\":{},\"frames\":[{}]}}", kWidth, kHeight,
                           c.fx, frames));
  };
  write_images(folder / "images/one", 0, 2);
  write_images(folder / "masks/one", 0, 2);
  write("");
  const auto motion = load(folder.path);
  REQUIRE(motion.ok());
  CHECK(motion->cameras.at(0).masks.size() == 2);
  write(",\"mask_path\":\"masks/one/000000.png\"");
  const auto validity = load(folder.path);
  REQUIRE(validity.ok());
  CHECK(validity->cameras.at(0).masks.empty());
}

TEST_CASE("supplied flow must cover every frame and needs a camera without distortion") {
  const TemporaryFolder folder;
  write_abc(folder, 3, GENERATE("", ",\"dist\":[-0.1,0,0,0]"));
  const bool distorted = load(folder.path)->cameras.at(0).lens != LensModel::kPinhole;
  write_text(folder / "flow/b/000000.flo", "");
  if (distorted) {
    const Status status = planned(folder.path);
    CHECK(status.code() == StatusCode::kUnsupported);
    CHECK(fails_with(status, {"flow/b", "'b'", "distorts"}));
    return;
  }
  CHECK(fails_with(planned(folder.path), {"flow/b/000001.flo", "'b'", "frame 1"}));
  write_text(folder / "flow/b/000001.flo", "");
  CHECK(planned(folder.path).ok());
  PrepareSettings held_out;
  held_out.test_cameras = {"b"};
  fs::remove(folder / "flow/b/000000.flo");
  CHECK(planned(folder.path, held_out).ok());
  fs::rename(folder / "flow/b", folder / "flow/cam_b");
  CHECK(fails_with(planned(folder.path), {"/flow", "any camera"}));
}

// A BMP header that states more pixels than OpenCV decodes.
std::string enormous_bmp() {
  std::string bytes = "BM";
  for (const std::uint32_t v : {54u, 0u, 54u, 40u, 60000u, 60000u}) append(bytes, v);
  append(bytes, std::uint16_t{1});
  append(bytes, std::uint16_t{24});
  for (int i = 0; i < 6; ++i) append(bytes, std::uint32_t{0});
  return bytes;
}

TEST_CASE("an image at which OpenCV throws is reported as a damaged file of its camera and frame") {
  const TemporaryFolder folder;
  write_abc(folder, 3);
  PrepareSettings half;
  half.scale = 0.5;
  for (const int frame : {2, 0}) {  // found while writing, and while probing the first frame
    fs::remove(folder / fmt::format("images/b/{:06}.png", frame));
    write_bytes(folder / fmt::format("images/b/{:06}.bmp", frame), enormous_bmp());
    const Status status = load_and_write(folder.path, half, folder / fmt::format("out{}", frame));
    CHECK(status.code() == StatusCode::kInvalidFile);
    CHECK(fails_with(status, {fmt::format("images/b/{:06}.bmp", frame),
                              fmt::format("camera 'b' frame {}", frame)}));
  }
}

TEST_CASE("easyvolcap: an entry that is not a matrix makes the file invalid") {
  const TemporaryFolder folder;
  write_text(folder / "intri.yml", "%YAML:1.0\n---\nnames:\n   - \"00\"\nK_00: \"none\"\n");
  write_text(folder / "extri.yml", "%YAML:1.0\n---\nnames:\n   - \"00\"\n");
  const Status status = load(folder.path).status();
  CHECK(status.code() == StatusCode::kInvalidFile);
  CHECK(fails_with(status, {"intri.yml", "K_00"}));
}

TEST_CASE("a camera name that is not UTF-8 is rejected before any work") {
  const TemporaryFolder folder;
  write_n3dv(folder.path, 3, 2);
  fs::rename(folder / "cam01.mp4", folder / "cam01\xe9.mp4");
  const Status status = load(folder.path).status();
  CHECK(status.code() == StatusCode::kInvalidFile);
  CHECK(fails_with(status, {"cam01", "UTF-8"}));
}

TEST_CASE("a folder that cannot be replaced stays unchanged") {
  const TemporaryFolder folder;
  write_text(folder / "out/capture.json", "old");
  CHECK(fails_with(replace_folder(folder / "nothing", folder / "out", true),
                   {"/out", "cannot move the result"}));
  CHECK(fs::exists(folder / "out/capture.json"));
  write_text(folder / "made/new.json", "new");
  CHECK(fails_with(replace_folder(folder / "made", folder / "out", false),
                   {"/out", "created by another program"}));
  CHECK(fs::exists(folder / "out/capture.json"));
  REQUIRE(replace_folder(folder / "made", folder / "out", true).ok());
  CHECK(fs::exists(folder / "out/new.json"));
  CHECK_FALSE(fs::exists(folder / "out/capture.json"));
}

TEST_CASE("a failed prepare removes every folder that it created, including parents") {
  const TemporaryFolder folder;
  fs::create_directory(folder / "empty");
  fs::create_directory(folder / "existing");
  CHECK_FALSE(prepare(folder / "empty", folder / "new/newer/out", {}, {}, {}).ok());
  CHECK_FALSE(prepare(folder / "empty", folder / "existing/out", {}, {}, {}).ok());
  CHECK_FALSE(fs::exists(folder / "new"));
  CHECK(fs::is_empty(folder / "existing"));
}

// A minimal capture that can be written and read.
PreparedCapture valid_capture(const TemporaryFolder& folder) {
  PreparedCapture capture;
  capture.folder = folder.path;
  capture.frames = 1;
  capture.cameras = {known_camera(0, 3, "a")};
  return capture;
}

TEST_CASE("capture.json with numbers that training cannot use is rejected") {
  const TemporaryFolder folder;
  const PreparedCapture valid = valid_capture(folder);
  REQUIRE(write_prepared_capture(valid).ok());
  CHECK(read_prepared_capture(folder.path).ok());
  const auto rejects = [&](const auto& change, const std::vector<std::string>& words) {
    PreparedCapture capture = valid;
    change(capture);
    CHECK(fails_with(write_prepared_capture(capture), words));
  };
  rejects([](auto& c) { c.near_plane = -1; }, {"capture.json", "near_plane (-1)"});
  rejects([](auto& c) { c.extent = 0; }, {"extent (0)"});
  rejects([](auto& c) { c.scene_radius = std::nan(""); }, {"scene_radius"});
  rejects([](auto& c) { c.scene_centre[1] = 1e300; }, {"scene_centre"});
  rejects([](auto& c) { c.cameras[0].cx = 1e300; }, {"'a'", "centre"});
  rejects([](auto& c) { c.cameras[0].rotation[4] += 0.1; }, {"'a'", "rotation"});
  rejects(
      [](auto& c) {
        for (double& r : c.cameras[0].rotation) r = -r;
      },
      {"'a'", "rotation"});
  rejects([](auto& c) { c.cameras[0].translation[2] = 1e300; }, {"'a'", "translation"});
  rejects([](auto& c) { c.cameras[0].name = "a\xe9"; }, {"capture.json", "UTF-8"});

  std::ifstream in(folder / "capture.json");
  std::string text{std::istreambuf_iterator<char>(in), {}};
  const std::size_t at = text.find("\"near_plane\": ");
  REQUIRE(at != std::string::npos);
  text.insert(at + std::string("\"near_plane\": ").size(), "-");
  write_text(folder / "capture.json", text);
  CHECK(fails_with(read_prepared_capture(folder.path).status(), {"capture.json", "near_plane"}));
}

}  // namespace
}  // namespace stgs::encoder::capture_test
