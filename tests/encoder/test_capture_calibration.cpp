// SPDX-License-Identifier: Apache-2.0
// Calibrations of other tools next to videos: Pose2Sim and Anipose, Qualisys, OpenCV.
#include <algorithm>
#include <opencv2/calib3d.hpp>

#include "capture_fixture.h"
#include "src/capture/calibration.h"
#include "src/capture/camera_names.h"

namespace stgs::encoder::capture_test {
namespace {

constexpr int kCameras = 3;

void write_videos(const TemporaryFolder& folder, int cameras = kCameras) {
  for (int i = 0; i < cameras; ++i) {
    write_video(folder / fmt::format("videos/cam{:02}.mp4", i + 1), i, 1);
  }
}

cv::Vec3d rotation_vector(const Camera& c) {
  cv::Vec3d vector;
  cv::Rodrigues(cv::Matx33d(c.rotation), vector);
  return vector;
}

// As Pose2Sim writes it: names with another separator than the videos'.
std::string pose2sim_table(int i, const std::string& name) {
  const Camera c = known_camera(i, kCameras, name);
  const cv::Vec3d r = rotation_vector(c);
  return fmt::format(
      "[{0}]\nname = \"{0}\"\nsize = [ {1}.0, {2}.0]\n"
      "matrix = [ [ {3}, 0.0, {4}], [ 0.0, {5}, {6}], [ 0.0, 0.0, 1.0]]\n"
      "distortions = [ -0.1, 1e-02, 0.0, 0.0]\nrotation = [ {7:.17g}, {8:.17g}, {9:.17g}]\n"
      "translation = [ {10:.17g}, {11:.17g}, {12:.17g}]\nfisheye = false\n\n",
      name, kWidth, kHeight, c.fx, c.cx - 0.5, c.fy, c.cy - 0.5, r[0], r[1], r[2], c.translation[0],
      c.translation[1], c.translation[2]);
}

std::string pose2sim_file() {
  std::string text = "# calibrated\n";
  for (int i = 0; i < kCameras; ++i) text += pose2sim_table(i, fmt::format("cam_{}", i + 1));
  return text + "[metadata]\nadjusted = false\nerror = 0.0\n";
}

// Checks cameras, frames and the half pixel that OpenCV's convention lacks.
void check_cameras(const Result<SourceCapture>& capture, double tolerance,
                   const std::vector<double>& distortion) {
  INFO(capture.status().message());
  REQUIRE(capture.ok());
  CHECK(capture->layout == Layout::kVideos);
  REQUIRE(capture->cameras.size() == kCameras);
  for (int i = 0; i < kCameras; ++i) {
    const SourceCamera& camera = capture->cameras[i];
    CHECK(camera.name == fmt::format("cam{:02}", i + 1));
    CHECK(fs::path(camera.video).stem() == camera.name);
    CHECK(camera.width == kWidth);
    CHECK(camera.height == kHeight);
    CHECK(difference(camera, known_camera(i, kCameras, "")) < tolerance);
    CHECK(camera.distortion == distortion);
  }
}

bool logged(const std::string& words) {
  const auto& lines = log_lines();
  return std::any_of(lines.begin(), lines.end(), [&](const std::string& line) {
    return line.find(words) != std::string::npos;
  });
}

TEST_CASE("a Pose2Sim calibration is read from beside the videos and from calibration/") {
  const TemporaryFolder folder;
  write_videos(folder);
  const std::string name =
      GENERATE("Calib.toml", "calibration/Calib_scene.toml", "videos/calibration.toml");
  write_text(folder / name, pose2sim_file());
  write_text(folder / "Config.toml", "[project]\nmode = \"\"\"{'a':1}\"\"\"\n");
  const auto capture = load(folder.path);
  check_cameras(capture, 1e-9, {-0.1, 0.01, 0, 0});
  CHECK_FALSE(capture->metric);
  CHECK(logged("calibration of 3 cameras"));
}

TEST_CASE("cameras.json overrides calibrations of other tools") {
  const TemporaryFolder folder;
  write_videos(folder);
  write_text(folder / "Calib.toml", "not TOML");
  std::string list;
  for (int i = 0; i < kCameras; ++i) {
    const Camera c = known_camera(i, kCameras, "");
    list += fmt::format("{}\"cam{:02}\":{{\"K\":{},\"w2c\":{}}}", i == 0 ? "" : ",", i + 1,
                        json_list(matrix_k(c)), json_list(world_to_camera(c)));
  }
  write_text(folder / "cameras.json", "{" + list + "}");
  CHECK(load(folder.path).ok());
}

TEST_CASE("Anipose: a fisheye lens, arrays over several lines") {
  const TemporaryFolder folder;
  write_text(folder / "calibration.toml",
             "[cam_0]\nname = 'A'\nsize = [ 64, 48,]\nmatrix = [ [ 60.0, 0.0, 31.5,], # fx\n"
             "  [ 0.0, 60.0, 23.5,],\r\n [ 0.0, 0.0, 1.0,],]\n"
             "distortions = [\n 0.1,\n 0.0, 0.0, 0.0\n]\nrotation = [ 0, 0, 0,]\n"
             "translation = [ +1.5, 0, -2,]\nfisheye = true\n[metadata]\n");
  const auto calibration = read_toml_calibration(*files_of(folder), folder / "calibration.toml");
  INFO(calibration.status().message());
  REQUIRE(calibration.ok());
  REQUIRE(calibration->cameras.size() == 1);
  const SourceCamera& camera = calibration->cameras[0];
  CHECK(camera.name == "A");
  CHECK(camera.lens == LensModel::kFisheye);
  CHECK(camera.cx == 32);
  CHECK(camera.rotation[4] == 1);
  CHECK(camera.translation[0] == 1.5);
}

TEST_CASE("damaged and incomplete TOML calibrations are named with their line") {
  const TemporaryFolder folder;
  write_videos(folder);
  const auto refused = [&](const std::string& text, const std::vector<std::string>& words) {
    write_text(folder / "Calib.toml", text);
    const Status status = load(folder.path).status();
    CHECK(status.code() == StatusCode::kInvalidFile);
    CHECK(fails_with(status, {"Calib.toml"}));
    CHECK(fails_with(status, words));
  };
  refused("[cam_1\n", {"not valid TOML at line 1"});
  refused("[cam_1]\nmatrix = [ 1, 2\n", {"not valid TOML at line", "end-of-file"});
  refused("[cam_1]\nname = \"a\" b\n", {"not valid TOML at line 2"});
  refused("a = 1\na = 2\n", {"not valid TOML at line 2", "'a'"});
  refused("a = " + std::string(100000, '[') + "\n", {"not valid TOML at line 1"});
  refused("[metadata]\nerror = 0.0\n", {"no cameras", "matrix"});
  refused("[cam_1]\nmatrix = [[9,0,5],[0,9,5],[0,0,1]]\n", {"'distortions' is missing"});
  refused("[cam_1]\nmatrix = [[9,0,nan],[0,9,5],[0,0,1]]\n", {"'matrix'", "finite numbers"});
  std::string text = pose2sim_file();
  const std::string whole = text;
  text.replace(text.find("translation = [ "), 16, "translation = [ 7, ");
  refused(text, {"camera 'cam_1'", "got 3 and 4"});
  // Only intrinsics were calibrated.
  text.clear();
  for (int i = 0; i < kCameras; ++i) {
    text += fmt::format(
        "[cam_{}]\nmatrix = [[9,0,5],[0,9,5],[0,0,1]]\ndistortions = [0,0,0,0]\n"
        "rotation = [0,0,0]\ntranslation = [0,0,0]\n",
        i + 1);
  }
  refused(text, {"same pose", "extrinsics"});
  write_text(folder / "calibration/Calib.toml", whole);
  refused(whole, {"several calibrations"});
}

// A TOML file cut anywhere is read or refused, but never read past its end.
TEST_CASE("a TOML file cut anywhere is read or refused") {
  const TemporaryFolder folder;
  const std::string whole = pose2sim_file();
  for (std::size_t kept = 0; kept < whole.size(); kept += 3) {
    write_text(folder / "a.toml", whole.substr(0, kept));
    const auto read = read_toml_calibration(*files_of(folder), folder / "a.toml");
    if (!read.ok()) CHECK(read.status().code() == StatusCode::kInvalidFile);
  }
}

// As QTM exports it: millimetres, 1/64 pixel, axes right, up and backward.
std::string qualisys_file(const std::string& intrinsic = "") {
  std::string text = "<?xml version='1.0'?>\n<!-- made by QTM -->\n<calibration>\n <cameras>\n";
  for (int i = 0; i < kCameras; ++i) {
    const Camera c = known_camera(i, kCameras, "");
    const double* r = c.rotation;
    const cv::Vec3d o = 1000 * centre_of(c.rotation, c.translation);
    text += fmt::format(
        "<camera active=\"1\" model=\"none\" serial=\"cam_{}\" viewrotation=\"0\">\n"
        "<fov_video bottom=\"{}\" left=\"2\" right=\"{}\" top=\"3\"/>\n"
        "<transform r11=\"{:.17g}\" r12=\"{:.17g}\" r13=\"{:.17g}\" r21=\"{:.17g}\" r22=\"{:.17g}\""
        " r23=\"{:.17g}\" r31=\"{:.17g}\" r32=\"{:.17g}\" r33=\"{:.17g}\" x=\"{:.17g}\" "
        "y=\"{:.17g}\" z=\"{:.17g}\"/>\n",
        i + 1, kHeight + 2, kWidth + 1, r[0], r[1], r[2], -r[3], -r[4], -r[5], -r[6], -r[7], -r[8],
        o[0], o[1], o[2]);
    text += fmt::format(
        "<intrinsic focalLengthU=\"{}\" focalLengthV=\"{}\" centerPointU=\"{}\" "
        "centerPointV=\"{}\" skew=\"0.0\" radialDistortion1=\"-0.1\" radialDistortion2=\"0.01\" "
        "radialDistortion3=\"0.0\" tangentalDistortion1=\"0\" tangentalDistortion2=\"0\"{}/>\n"
        "</camera>\n",
        64 * c.fx, 64 * c.fy, 64 * (c.cx - 0.5 + 2), 64 * (c.cy - 0.5 + 3), intrinsic);
  }
  // One that is switched off, and one that sees only markers.
  return text +
         "<camera active='0' serial='98'></camera>\n<camera active='1' serial='99'>"
         "<fov_marker left='0'/></camera>\n</cameras>\n</calibration>\n";
}

TEST_CASE("a Qualisys calibration is read, before the TOML file made from it") {
  const TemporaryFolder folder;
  write_videos(folder);
  write_text(folder / GENERATE("calibration/Calib.qca.txt", "calibration.xml"), qualisys_file());
  write_text(folder / "calibration/Calib_qualisys.toml", "[metadata]\n");
  const auto capture = load(folder.path);
  check_cameras(capture, 1e-9, {-0.1, 0.01, 0, 0, 0});
  CHECK(capture->metric);
}

TEST_CASE("damaged Qualisys calibrations are named") {
  const TemporaryFolder folder;
  write_videos(folder);
  const auto refused = [&](const std::string& text, const std::vector<std::string>& words) {
    write_text(folder / "a.qca.txt", text);
    const Status status = load(folder.path).status();
    CHECK(status.code() == StatusCode::kInvalidFile);
    CHECK(fails_with(status, {"a.qca.txt"}));
    CHECK(fails_with(status, words));
  };
  const std::string whole = qualisys_file();
  const auto changed = [&](const std::string& from, const std::string& to) {
    std::string text = whole;
    text.replace(text.find(from), from.size(), to);
    return text;
  };
  refused("some text", {"not valid XML"});
  refused("<calibration/>", {"not a Qualisys calibration"});
  refused(whole.substr(0, whole.find("<intrinsic") + 30), {"not valid XML", "[byte "});
  refused(changed("skew=\"0.0\"", "skew=\"none\""), {"cam_1", "<intrinsic> skew", "'none'"});
  refused(changed(" skew=\"0.0\"", ""), {"cam_1", "no attribute skew"});
  refused(changed("<transform", "<other"), {"cam_1", "<transform> is missing"});
  refused(changed("left=\"2\"", "left=\"900\""), {"cam_1", "image size"});
  for (std::size_t kept = 0; kept < whole.size(); kept += 7) {
    write_text(folder / "b.qca.txt", whole.substr(0, kept));
    (void)read_qualisys(*files_of(folder), folder / "b.qca.txt", [](int, const std::string&) {});
  }
}

std::string opencv_yaml(const Camera& c, bool vector) {
  const auto matrix = [](const char* name, int rows, int columns, const std::vector<double>& data) {
    return fmt::format("{}: !!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: {}\n",
                       name, rows, columns, json_list(data));
  };
  const cv::Vec3d r = rotation_vector(c);
  return fmt::format("%YAML:1.0\n---\nimage_width: {}\nimage_height: {}\n", kWidth, kHeight) +
         matrix("camera_matrix", 3, 3, matrix_k(c, 0)) +
         matrix("distortion_coefficients", 1, 5, {-0.1, 0.01, 0, 0, 0}) +
         (vector ? matrix("rvec", 3, 1, {r[0], r[1], r[2]})
                 : matrix("R", 3, 3, std::vector<double>(c.rotation, c.rotation + 9))) +
         matrix("T", 3, 1, std::vector<double>(c.translation, c.translation + 3));
}

TEST_CASE("OpenCV's YAML of each camera is read") {
  const bool vector = GENERATE(false, true);
  const TemporaryFolder folder;
  write_videos(folder);
  for (int i = 0; i < kCameras; ++i) {
    write_text(folder / fmt::format("{}/cam{:02}.yml", i == 0 ? "videos" : "calibration", i + 1),
               opencv_yaml(known_camera(i, kCameras, ""), vector));
  }
  check_cameras(load(folder.path), 1e-6, {-0.1, 0.01, 0, 0, 0});
}

TEST_CASE("OpenCV's JSON of each camera is read, with plain lists as matrices") {
  const TemporaryFolder folder;
  write_videos(folder);
  for (int i = 0; i < kCameras; ++i) {
    const Camera c = known_camera(i, kCameras, "");
    write_text(folder / fmt::format("calib_cam_{}.json", i + 1),
               fmt::format("{{\"K\":[[{},0,{}],[0,{},{}],[0,0,1]],\"dist\":[-0.1,0.01,0,0,0],"
                           "\"R\":{},\"T\":{},\"width\":{},\"height\":{}}}",
                           c.fx, c.cx - 0.5, c.fy, c.cy - 0.5,
                           json_list(std::vector<double>(c.rotation, c.rotation + 9)),
                           json_list(std::vector<double>(c.translation, c.translation + 3)), kWidth,
                           kHeight));
  }
  check_cameras(load(folder.path), 1e-6, {-0.1, 0.01, 0, 0, 0});
}

TEST_CASE("OpenCV's XML is not taken for a Qualisys calibration") {
  const TemporaryFolder folder;
  write_videos(folder);
  for (int i = 0; i < kCameras; ++i) {
    const std::string path = folder / fmt::format("calib_cam{:02}.xml", i + 1);
    const Camera c = known_camera(i, kCameras, "");
    const std::vector<double> k = matrix_k(c, 0), distortion = {-0.1, 0.01, 0, 0, 0};
    cv::FileStorage file(path, cv::FileStorage::WRITE);
    file << "calibration_time"
         << "today"
         << "image_width" << kWidth << "image_height" << kHeight << "camera_matrix"
         << cv::Mat(cv::Matx33d(k.data())) << "distortion_coefficients" << cv::Mat(distortion)
         << "R" << cv::Mat(cv::Matx33d(c.rotation)) << "T" << cv::Mat(cv::Matx31d(c.translation));
  }
  check_cameras(load(folder.path), 1e-9, {-0.1, 0.01, 0, 0, 0});
}

TEST_CASE("two calibrations of one camera, and an invalid size, are refused") {
  const TemporaryFolder folder;
  write_videos(folder);
  for (int i = 0; i < kCameras; ++i) {
    write_text(folder / fmt::format("cam{:02}.yml", i + 1),
               opencv_yaml(known_camera(i, kCameras, ""), false));
  }
  std::string text = opencv_yaml(known_camera(1, kCameras, ""), true);
  SECTION("two") {
    write_text(folder / "calibration/Cam_2.yaml", text);
    CHECK(
        fails_with(load(folder.path).status(), {"Cam_2.yaml", "cam02.yml", "another calibration"}));
  }
  SECTION("size") {
    write_text(folder / "cam02.yml", text.replace(text.find("64"), 2, "-5"));
    CHECK(fails_with(load(folder.path).status(), {"cam02.yml", "invalid image size"}));
  }
}

TEST_CASE("a damaged file among OpenCV's calibrations is named") {
  const TemporaryFolder folder;
  write_videos(folder);
  write_text(folder / "cam01.yml", opencv_yaml(known_camera(0, kCameras, ""), true));
  write_text(folder / "cam02.yml", opencv_yaml(known_camera(1, kCameras, ""), true));
  write_text(folder / "cam03.yml", "%YAML:1.0\n---\ncamera_matrix: [ 1, 2\nR: \"");
  CHECK(fails_with(load(folder.path).status(), {"cam03.yml"}));
}

TEST_CASE("calibrations that cannot be read are named where COLMAP fails") {
  const TemporaryFolder folder;
  write_videos(folder, 2);
  write_text(folder / "cam01.json", "{\"K\":[[9,0,5],[0,9,5],[0,0,1]]}");  // no pose
  write_text(folder / "calibration/session.xcp", "<Cameras/>");
  const Status status = load(folder.path).status();
  CHECK(fails_with(status, {"cam01.json", "session.xcp"}));
  CHECK(logged("session.xcp: ignored"));
}

TEST_CASE("cameras of a calibration and videos match by letters and numbers") {
  const auto same_camera_name = [](const std::string& a, const std::string& b) {
    SourceCamera camera;
    camera.name = b;
    const Result<std::size_t> found = CameraNames({camera}).find(a, "Calib.toml");
    return found.ok() && *found == 0;
  };
  CHECK(same_camera_name("cam01", "cam_1"));
  CHECK(same_camera_name("int_cam01_img", "Cam1"));
  CHECK(same_camera_name("A", "vid-camA"));
  CHECK(same_camera_name("23512", "Miqus_3_23512"));
  CHECK(same_camera_name("cam00", "cam0"));
  CHECK_FALSE(same_camera_name("cam1", "cam10"));
  CHECK_FALSE(same_camera_name("left", "right"));
  CHECK_FALSE(same_camera_name("", "cam1"));
  CHECK(fails_with(CameraNames({}).find(std::string(256, 'a'), "Calib.toml").status(),
                   {"Calib.toml", "256 bytes"}));

  const TemporaryFolder folder;
  write_text(folder / "Calib.toml", pose2sim_file());
  SECTION("no match") {
    write_video(folder / "left.mp4", 0, 1);
    write_video(folder / "right.mp4", 1, 1);
    CHECK(fails_with(load(folder.path).status(), {"Calib.toml", "'cam_1'", "'left'", "rename"}));
  }
  SECTION("several matches") {
    write_video(folder / "run1_cam1.mp4", 0, 1);
    write_video(folder / "run2_cam1.mp4", 1, 1);
    CHECK(fails_with(load(folder.path).status(), {"Calib.toml", "'run1_cam1' or 'run2_cam1'"}));
  }
  SECTION("a video without calibration is left out") {
    write_videos(folder);
    write_video(folder / "videos/extra.mp4", 3, 1);
    const auto capture = load(folder.path);
    REQUIRE(capture.ok());
    CHECK(capture->cameras.size() == kCameras);
    CHECK(logged("'extra' ignored"));
  }
}

}  // namespace
}  // namespace stgs::encoder::capture_test
