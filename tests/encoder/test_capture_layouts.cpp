// SPDX-License-Identifier: Apache-2.0
// Every capture layout is read back with the cameras that it was written with.
#include "capture_fixture.h"

#include "catch.h"

namespace stgs::encoder::capture_test {
namespace {

constexpr int kCameras = 5;

TEST_CASE("n3dv: LLFF poses become world-to-camera matrices, and the first camera is held out") {
  const TemporaryFolder folder;
  write_n3dv(folder.path, 3, 2);
  const auto capture = load(folder.path);
  REQUIRE(capture.ok());
  CHECK(capture->layout == Layout::kN3dv);
  REQUIRE(capture->cameras.size() == 3);
  for (int i = 0; i < 3; ++i) {
    Camera expected = known_camera(i, 3, fmt::format("cam{:02}", i));
    expected.fy = expected.fx;
    expected.cx = 0.5 * kWidth;
    expected.cy = 0.5 * kHeight;
    CHECK(capture->cameras[i].name == expected.name);
    CHECK(difference(capture->cameras[i], expected) < 1e-9);
    CHECK(capture->cameras[i].test == (i == 0));
  }
}

void write_panoptic(const TemporaryFolder& folder, const std::string& name, int from, int to,
                    int moving) {
  std::string k, w2c, fn, id;
  for (int f = 0; f < 2; ++f) {
    const char* comma = f == 0 ? "" : ",";
    k += fmt::format("{}[", comma), w2c += fmt::format("{}[", comma);
    fn += fmt::format("{}[", comma), id += fmt::format("{}[", comma);
    for (int i = from; i < to; ++i) {
      Camera c = known_camera(i, kCameras, "");
      if (f == 1 && i == moving) c.translation[0] += 0.1;
      const char* next = i == from ? "" : ",";
      const auto m = world_to_camera(c);
      k += fmt::format("{}[[{},0,{}],[0,{},{}],[0,0,1]]", next, c.fx, c.cx, c.fy, c.cy);
      w2c += fmt::format("{}{}", next, json_list(m));
      fn += fmt::format("{}\"{}/{:06}.jpg\"", next, i, f);
      id += fmt::format("{}{}", next, i);
      write_image(fmt::format("{}/ims/{}/{:06}.jpg", folder.path, i, f), test_image(i, f));
      cv::Mat mask = cv::Mat::zeros(kHeight, kWidth, CV_8UC1);
      mask.colRange(0, kWidth / 2).setTo(1);  // values 0 and 1, as some tools write
      if (i != 0) write_image(fmt::format("{}/seg/{}/{:06}.png", folder.path, i, f), mask);
    }
    k += "]", w2c += "]", fn += "]", id += "]";
  }
  write_text(folder / name, fmt::format("{{\"w\":{},\"h\":{},\"k\":[{}],\"w2c\":[{}],\"fn\":[{}],"
                                        "\"cam_id\":[{}]}}",
                                        kWidth, kHeight, k, w2c, fn, id));
}

TEST_CASE("panoptic: cameras, the train/test split and masks are read") {
  const TemporaryFolder folder;
  write_panoptic(folder, "train_meta.json", 1, kCameras, -1);
  write_panoptic(folder, "test_meta.json", 0, 1, -1);
  const auto capture = load(folder.path);
  REQUIRE(capture.ok());
  CHECK(capture->fps == 30);
  REQUIRE(capture->cameras.size() == kCameras);
  for (int i = 0; i < kCameras; ++i) {
    const SourceCamera& camera = capture->cameras[i];
    CHECK(camera.name == std::to_string(i));
    CHECK(camera.test == (i == 0));
    CHECK(camera.images.size() == 2);
    CHECK(camera.masks.size() == (i == 0 ? 0 : 2));
    CHECK(difference(camera, known_camera(i, kCameras, "")) < 1e-5);
  }

  PrepareSettings settings;
  PreparedCapture prepared;
  prepared.folder = folder / "out";
  const auto plans = plan_frames(*capture, settings, prepared, [](int, const std::string&) {});
  REQUIRE(plans.ok());
  OpenVideos videos;
  REQUIRE(write_frames(*capture, *plans, prepared, videos, {}).ok());
  CHECK(prepared.frame_extension == "jpg");
  const auto size = [](const std::string& path) { return fs::file_size(path); };
  CHECK(size(prepared.frame_path(prepared.cameras[2], 1)) == size(folder / "ims/2/000001.jpg"));
  const auto mask = load_mask(prepared, prepared.cameras[2], 1);
  REQUIRE(mask.ok());
  CHECK(int(mask->data[0]) == 255);
  CHECK(int(mask->data[kWidth - 1]) == 0);
  CHECK_FALSE(fs::exists(prepared.mask_path(prepared.cameras[0], 0)));
}

TEST_CASE("panoptic: a moving camera is rejected, naming camera and frame") {
  const TemporaryFolder folder;
  write_panoptic(folder, "train_meta.json", 1, kCameras, 3);
  CHECK(fails_with(load(folder.path).status(), {"train_meta.json", "camera '3'", "frame 1"}));
}

TEST_CASE("easyvolcap: principal points shift by half a pixel, and the middle camera is held out") {
  const bool videos = GENERATE(false, true);
  const TemporaryFolder folder;
  write_easyvolcap(folder, kCameras, 2, videos);
  const auto capture = load(folder.path);
  REQUIRE(capture.ok());
  REQUIRE(capture->cameras.size() == kCameras);
  for (int i = 0; i < kCameras; ++i) {
    const SourceCamera& camera = capture->cameras[i];
    CHECK(difference(camera, known_camera(i, kCameras, "")) < 1e-9);
    CHECK(camera.lens == LensModel::kOpenCv);
    CHECK(camera.distortion == std::vector<double>{-0.1, 0.01, 0, 0, 0});
    CHECK(camera.test == (i == 2));
    CHECK(camera.video.empty() == !videos);
  }
  CHECK(log_lines().back().find("'02'") != std::string::npos);
}

TEST_CASE("easyvolcap: errors name damaged and missing entries") {
  const TemporaryFolder folder;
  write_easyvolcap(folder, kCameras, 2, false);
  fs::remove_all(folder / "images/03");
  CHECK(fails_with(load(folder.path).status(), {"camera '03'", "images/03"}));
  write_text(folder / "extri.yml", "%YAML:1.0\n---\nT_00: 5\n");
  CHECK(fails_with(load(folder.path).status(), {"extri.yml", "camera '00'", "Rot_00"}));
  write_text(folder / "intri.yml", "%YAML:1.0\n---\nnames: [ \"00\"\nK_00: !!opencv-matrix");
  CHECK(fails_with(load(folder.path).status(), {"intri.yml"}));
}

cv::Vec4d quaternion(const Camera& c) {
  const double* r = c.rotation;  // w is never near 0 for known_camera()
  const double w = 0.5 * std::sqrt(1 + r[0] + r[4] + r[8]);
  return {w, (r[7] - r[5]) / (4 * w), (r[2] - r[6]) / (4 * w), (r[3] - r[1]) / (4 * w)};
}

void write_colmap_text(const TemporaryFolder& folder) {
  std::string cameras = "# cameras\n", images = "# images\n";
  const char* models[] = {"PINHOLE", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "PINHOLE"};
  const char* tails[] = {"", " 0.1 0.02 0.001 0.002", " 0.1 0 0 0", " 0.1 0 0 0 0 0 0 0", ""};
  for (int i = 0; i < kCameras; ++i) {
    const Camera c = known_camera(i, kCameras, "");
    const cv::Vec4d q = quaternion(c);
    cameras += fmt::format("{} {} {} {} {} {} {} {}{}\n", i + 1, models[i], kWidth, kHeight, c.fx,
                           c.fy, c.cx, c.cy, tails[i]);
    images += fmt::format("{} {:.12f} {:.12f} {:.12f} {:.12f} {:.12f} {:.12f} {:.12f} {} {}\n\n",
                          i + 1, q[0], q[1], q[2], q[3], c.translation[0], c.translation[1],
                          c.translation[2], i + 1, fmt::format("cam{}/000000.png", i));
    write_images(folder / fmt::format("images/cam{}", i), i, 2);
  }
  write_text(folder / "sparse/0/cameras.txt", cameras);
  write_text(folder / "sparse/0/images.txt", images);
  write_text(folder / "sparse/0/points3D.txt", "1 0.5 -1 2 10 20 30 0.4 1 2 3 4\n");
}

TEST_CASE("colmap: text models with every lens model are read") {
  const TemporaryFolder folder;
  write_colmap_text(folder);
  const auto capture = load(folder.path);
  REQUIRE(capture.ok());
  REQUIRE(capture->cameras.size() == kCameras);
  const LensModel lenses[] = {LensModel::kPinhole, LensModel::kOpenCv, LensModel::kFisheye,
                              LensModel::kOpenCv, LensModel::kPinhole};
  for (int i = 0; i < kCameras; ++i) {
    CHECK(difference(capture->cameras[i], known_camera(i, kCameras, "")) < 1e-6);
    CHECK(capture->cameras[i].lens == lenses[i]);
    CHECK(capture->cameras[i].images.size() == 2);
  }
  REQUIRE(capture->points.size() == 1);
  CHECK(capture->points[0].position[2] == 2);
  CHECK(int(capture->points[0].colour[1]) == 20);
}

// One camera, one image without features, one point.
void write_colmap_binary(const TemporaryFolder& folder) {
  const Camera c = known_camera(0, kCameras, "");
  std::string cameras, images, points;
  append<std::uint64_t>(cameras, 1);
  append<std::uint32_t>(cameras, 7);
  append<std::uint32_t>(cameras, 2);  // SIMPLE_RADIAL
  append<std::uint64_t>(cameras, kWidth);
  append<std::uint64_t>(cameras, kHeight);
  for (double v : {c.fx, c.cx, c.cy, 0.05}) append(cameras, v);
  append<std::uint64_t>(images, 1);
  append<std::uint32_t>(images, 1);
  const cv::Vec4d q = quaternion(c);
  for (int i = 0; i < 4; ++i) append(images, q[i]);
  for (double v : c.translation) append(images, v);
  append<std::uint32_t>(images, 7);
  for (char letter : std::string("left.png")) append(images, letter);
  append(images, '\0');
  append<std::uint64_t>(images, 1);
  for (int i = 0; i < 3; ++i) append<std::uint64_t>(images, 0);
  append<std::uint64_t>(points, 1);
  append<std::uint64_t>(points, 1);
  for (double v : {1.0, 2.0, 3.0}) append(points, v);
  for (int i = 0; i < 3; ++i) append<std::uint8_t>(points, 99);
  append<double>(points, 0.5);
  append<std::uint64_t>(points, 1);
  append<std::uint64_t>(points, 0);
  write_bytes(folder / "sparse/cameras.bin", cameras);
  write_bytes(folder / "sparse/images.bin", images);
  write_bytes(folder / "sparse/points3D.bin", points);
  write_video(folder / "videos/left.mp4", 0, 2);
}

TEST_CASE("colmap: the initial points include the model's points") {
  const TemporaryFolder folder;
  write_colmap_text(folder);
  write_text(folder / "sparse/0/points3D.txt", "1 0.25 0.125 -0.25 1 254 3 0.4 1 2 3 4\n");
  const Status status = prepare(folder.path, folder / "out", {}, {}, {});
  INFO(status.message());
  REQUIRE(status.ok());
  const auto points = read_points(folder / "out/points_static.ply");
  REQUIRE(points.ok());
  CHECK(std::count_if(points->begin(), points->end(), [](const InitialPoint& p) {
          return p.position[0] == 0.25f && p.position[2] == -0.25f && p.colour[1] == 254;
        }) == 1);
}

TEST_CASE("colmap: a binary model with one video per camera is read") {
  const TemporaryFolder folder;
  write_colmap_binary(folder);
  const auto capture = load(folder.path);
  REQUIRE(capture.ok());
  REQUIRE(capture->cameras.size() == 1);
  Camera expected = known_camera(0, kCameras, "");
  expected.fy = expected.fx;
  CHECK(capture->cameras[0].name == "left");
  CHECK(difference(capture->cameras[0], expected) < 1e-9);
  CHECK(capture->cameras[0].distortion == std::vector<double>{0.05, 0, 0, 0});
  CHECK(capture->points.size() == 1);
}

TEST_CASE("colmap: a binary model truncated at any byte is rejected, naming the file") {
  const std::string file = GENERATE("cameras.bin", "images.bin", "points3D.bin");
  const TemporaryFolder folder;
  write_colmap_binary(folder);
  const std::string path = folder / ("sparse/" + file);
  while (fs::file_size(path) > 0) {
    shorten(path, 1);
    REQUIRE(fails_with(load(folder.path).status(), {file, "truncated"}));
  }
}

TEST_CASE("nerfstudio: OpenGL poses are converted, images are grouped by pose and sorted by time") {
  const TemporaryFolder folder;
  std::string frames;
  for (int f = 1; f >= 0; --f) {  // written in reverse order of time
    for (int i = 0; i < kCameras; ++i) {
      const Camera c = known_camera(i, kCameras, "");
      const cv::Vec3d o = centre_of(c.rotation, c.translation);
      const double* r = c.rotation;
      const std::string matrix = json_list({r[0], -r[3], -r[6], o[0], r[1], -r[4], -r[7], o[1],
                                            r[2], -r[5], -r[8], o[2], 0, 0, 0, 1});
      frames += fmt::format(
          "{}{{\"file_path\":\"shots/{}_{}.png\",\"time\":{},\"fl_x\":{},\"fl_y\":{},"
          "\"transform_matrix\":{}}}",
          frames.empty() ? "" : ",", 9 - f, i, f * 0.5, c.fx, c.fy, matrix);
      write_image(folder / fmt::format("shots/{}_{}.png", 9 - f, i), test_image(i, f));
    }
  }
  const std::string head = fmt::format(
      "{{\"w\":{},\"h\":{},\"cx\":32.25,\"cy\":23.75,\"k1\":0.02,\"fps\":25,", kWidth, kHeight);
  write_text(folder / "transforms.json", head + "\"frames\":[" + frames + "]}");
  const auto capture = load(folder.path);
  REQUIRE(capture.ok());
  REQUIRE(capture->cameras.size() == kCameras);
  CHECK(capture->fps == 25);
  for (int i = 0; i < kCameras; ++i) {
    const SourceCamera& camera = capture->cameras[i];
    CHECK(camera.name == fmt::format("cam0{}", i));
    CHECK(difference(camera, known_camera(i, kCameras, "")) < 1e-9);
    CHECK(camera.lens == LensModel::kOpenCv);
    REQUIRE(camera.images.size() == 2);
    CHECK(fs::path(camera.images[0]).filename() == fmt::format("9_{}.png", i));
  }
}

TEST_CASE("videos: every form of cameras.json is read") {
  const int form = GENERATE(0, 1, 2);
  const TemporaryFolder folder;
  std::string list;
  for (int i = 0; i < kCameras; ++i) {
    const std::string name = fmt::format("cam{}", i);
    const Camera c = known_camera(i, kCameras, name);
    const std::string body =
        fmt::format("\"K\":{},\"dist\":[0.1,0,0,0],\"w2c\":{}",
                    json_list(matrix_k(c, form == 2 ? 0 : 0.5)), json_list(world_to_camera(c)));
    if (i > 0) list += ",";
    list += form == 1 ? fmt::format("\"{}\":{{{}}}", name, body)
                      : fmt::format("{{\"name\":\"{}\",{}}}", name, body);
    write_video(folder / (form == 1 ? name + ".mp4" : "videos/" + name + ".mp4"), i, 2);
  }
  const std::string head = "{\"pixel_centre\":0,\"metric\":true,\"cameras\":[";
  write_text(folder / "cameras.json", form == 0   ? "[" + list + "]"
                                      : form == 1 ? "{" + list + "}"
                                                  : head + list + "]}");
  const auto capture = load(folder.path);
  REQUIRE(capture.ok());
  CHECK(capture->metric == (form == 2));
  REQUIRE(capture->cameras.size() == kCameras);
  for (int i = 0; i < kCameras; ++i) {
    CHECK(difference(capture->cameras[i], known_camera(i, kCameras, "")) < 1e-9);
    CHECK(capture->cameras[i].distortion == std::vector<double>{0.1, 0, 0, 0});
  }
}

TEST_CASE("videos: the error names the cameras that COLMAP cannot register") {
  const TemporaryFolder folder;
  for (int i = 0; i < 2; ++i) write_video(folder / fmt::format("plain{}.mp4", i), i, 1);
  const Status status = load(folder.path).status();
  if (status.code() == StatusCode::kNotBuilt) {
    CHECK(fails_with(status, {"colmap", "not installed"}));  // on machines without it
    return;
  }
  CHECK(fails_with(status, {folder.path, "'plain0', 'plain1'", "cameras.json"}));
}

TEST_CASE("the error for an unknown layout lists the files of every layout") {
  const TemporaryFolder folder;
  const Status status = load(folder.path).status();
  CHECK(status.code() == StatusCode::kInvalidFile);
  CHECK(fails_with(status, {"poses_bounds.npy", "train_meta.json", "intri.yml", "transforms.json",
                            "sparse/0", "cameras.json"}));
}

}  // namespace
}  // namespace stgs::encoder::capture_test
