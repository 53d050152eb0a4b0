// SPDX-License-Identifier: Apache-2.0
// Captures of others: nothing outside the folder is read, and counts and sizes are limited.
#include <sys/stat.h>

#include <array>
#include <chrono>
#include <thread>

#include "capture_fixture.h"
#include "catch.h"
#include "src/capture/file_kind.h"
#include "src/capture/run_program.h"

namespace stgs::encoder::capture_test {
namespace {

using Kind = CaptureFolder::Kind;
using Lookup = CaptureFolder::Lookup;

// A capture folder `in` and a folder `other` beside it, with an image and a video.
struct Beside {
  TemporaryFolder folder;
  std::string in = folder / "in", other = folder / "other";
  Beside() {
    fs::create_directory(in);
    write_images(other + "/cam", 0, 2);
    write_video(other + "/cam.mp4", 0, 2);
  }
};

bool is_refused(const Status& status, const std::vector<std::string>& words) {
  std::vector<std::string> all = words;
  all.emplace_back("--allow-outside");
  return fails_with(status, all) && status.code() == StatusCode::kInvalidFile;
}

TEST_CASE("a nerfstudio table cannot name files outside the capture") {
  const Beside beside;
  write_image(beside.in + "/a/0.png", test_image(0, 0));
  PrepareSettings trusted;
  trusted.allow_outside = true;
  for (const std::string& file :
       {std::string("../other/cam/000000.png"), std::string("a/../../other/cam/000000.png"),
        beside.other + "/cam/000000.png", std::string("../other/cam.mp4")}) {
    INFO(file);
    write_transforms(beside.in, {"a/0.png", file});
    CHECK(is_refused(load(beside.in).status(), {"transforms.json: file_path", file}));
    CHECK(load(beside.in, trusted).status().message().empty());
  }
  write_image(beside.in + "/a/1.png", test_image(0, 1));
  write_transforms(beside.in, {"a/0.png", "./a/../a/1.png"});  // stays inside
  CHECK(load(beside.in).ok());
}

TEST_CASE("tables of panoptic, easyvolcap and colmap cannot name files outside the capture") {
  const Beside beside;
  const auto table = [](const std::string& image) {
    return fmt::format(
        "{{\"w\":64,\"h\":48,\"fn\":[[\"{}\"]],\"cam_id\":[[0]],"
        "\"k\":[[[[60,0,32],[0,60,24],[0,0,1]]]],"
        "\"w2c\":[[[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]]]}}",
        image);
  };
  write_text(beside.in + "/train_meta.json", table("../../other/cam/000000.png"));
  CHECK(is_refused(load(beside.in).status(), {"train_meta.json: fn", "../../other"}));
  // Inside as a frame (ims/../x), outside as a mask of seg/ in another depth.
  write_text(beside.in + "/train_meta.json", table("../x/000000.png"));
  CHECK(is_refused(load(beside.in).status(), {"train_meta.json: fn"}));
  fs::remove(beside.in + "/train_meta.json");

  write_text(beside.in + "/intri.yml",
             "%YAML:1.0\n---\nnames:\n  - \"../../other/cam\"\n"
             "K_x: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n");
  write_text(beside.in + "/extri.yml", "%YAML:1.0\n---\nT_x: [0, 0, 0]\n");
  CHECK(is_refused(load(beside.in).status(), {"intri.yml: names", "../../other/cam"}));
  fs::remove(beside.in + "/intri.yml");

  write_text(beside.in + "/cameras.txt", "1 PINHOLE 64 48 60 60 32 24\n");
  write_text(beside.in + "/images.txt", "1 1 0 0 0 0 0 0 1 ../../other/cam/000000.png\n\n");
  CHECK(is_refused(load(beside.in).status(), {"image name", "../../other/cam/000000.png"}));
}

TEST_CASE("links may lead anywhere in the capture, but not out of it") {
  const Beside beside;
  write_images(beside.in + "/store/cam0", 0, 2);
  write_images(beside.in + "/store/cam1", 1, 2);
  write_transforms(beside.in, {"a/000000.png", "b/000000.png"});
  fs::create_directory_symlink("store/cam0", beside.in + "/a");
  fs::create_directory_symlink("store/cam1", beside.in + "/b");
  const auto planned = [&](bool allow_outside, const std::string& folder) -> Status {
    PrepareSettings settings;
    settings.allow_outside = allow_outside;
    settings.default_test_cameras = false;
    STGS_ASSIGN(const SourceCapture source, load(folder, settings));
    PreparedCapture prepared;
    return plan_frames(source, settings, prepared, [](int, const std::string&) {}).status();
  };
  CHECK(planned(false, beside.in).message().empty());
  fs::create_directory_symlink(beside.in, beside.folder / "link");
  CHECK(planned(false, beside.folder / "link").message().empty());  // the folder itself is a link

  const auto relink = [](const std::string& target, const std::string& link) {
    fs::remove_all(link);
    fs::create_symlink(target, link);
  };
  for (const std::string& target : {beside.other + "/cam", std::string("../other/cam")}) {
    relink(target, beside.in + "/b");
    CHECK(is_refused(planned(false, beside.in), {"in/b/000000.png"}));
    CHECK(planned(true, beside.in).message().empty());
  }
  relink("store/cam1", beside.in + "/b");
  for (const char* name : {"masks", "flow"}) {
    relink("../other", beside.in + "/" + name);
    CHECK(is_refused(planned(false, beside.in), {std::string("in/") + name}));
    fs::remove(beside.in + "/" + name);
  }
  relink("../other/transforms.json", beside.in + "/transforms.json");
  CHECK(is_refused(planned(false, beside.in), {"transforms.json"}));
}

TEST_CASE("videos, image folders, masks and flow behind links to the outside are not read") {
  const Beside beside;
  write_n3dv(beside.in, 3, 2);
  const auto prepared = [&] {
    PrepareSettings settings;
    return prepare(beside.in, beside.folder / "out", settings, {}, {});
  };
  const auto refused_at = [&](const std::string& target, const std::string& name) {
    const std::string link = beside.in + "/" + name;
    fs::create_directories(fs::path(link).parent_path());
    fs::remove(link);
    fs::create_symlink(target, link);
    const Status status = prepared();
    INFO(name << ": " << status.message());
    CHECK(is_refused(status, {name}));
    CHECK_FALSE(fs::exists(beside.folder / "out"));
  };
  const std::string image = beside.other + "/cam/000000.png";
  write_images(beside.in + "/masks/cam01", 0, 2);
  refused_at(image, "masks/cam01/000000.png");
  fs::remove_all(beside.in + "/masks");
  refused_at(beside.other, "flow/cam01");
  fs::remove_all(beside.in + "/flow");
  refused_at(beside.other + "/cam.mp4", "cam01.mp4");
}

TEST_CASE("a capture folder opens regular files below it, with and without openat2") {
  const Beside beside;
  const auto lookup = GENERATE(Lookup::kKernel, Lookup::kComponents);
  write_text(beside.in + "/a/b/file", "inside");
  write_text(beside.other + "/file", "outside");
  fs::create_symlink("../../other/file", beside.in + "/a/up");
  fs::create_symlink("b/file", beside.in + "/a/in");
  fs::create_symlink("/proc/self/cwd", beside.in + "/a/magic");
  REQUIRE(::mkfifo((beside.in + "/pipe").c_str(), 0600) == 0);
  const auto files = *CaptureFolder::open(beside.in, false, lookup);
  const auto text = [&](const std::string& name) {
    const auto bytes = files->read(beside.in + "/" + name, 100);
    INFO(bytes.status().message());
    return bytes.ok() ? std::string(bytes->begin(), bytes->end()) : std::string();
  };
  CHECK(text("a/b/file") == "inside");
  CHECK(text("a//b/./file") == "inside");
  CHECK(text("a/in") == (lookup == Lookup::kKernel ? "inside" : ""));
  CHECK(files->kind(beside.in + "/a/up") == Kind::kOutside);
  CHECK(files->kind(beside.in + "/a/magic") == Kind::kOutside);
  CHECK(files->kind(beside.in + "/none") == Kind::kMissing);
  CHECK(files->kind(beside.in + "/pipe") == Kind::kOther);
  CHECK(files->kind(beside.in) == Kind::kFolder);
  CHECK(is_refused(files->read(beside.in + "/a/up", 100).status(), {"a/up"}));
  CHECK(is_refused(files->read(beside.in + "/../other/file", 100).status(), {"other/file"}));
  CHECK(is_refused(files->read(beside.other + "/file", 100).status(), {"other/file"}));
  CHECK(is_refused(files->list(beside.in + "/..").status(), {"in/.."}));
  CHECK(fails_with(files->read(beside.in + "/pipe", 100).status(), {"pipe: not a regular file"}));
  CHECK(fails_with(files->read(beside.in + "/a/b/file", 5).status(), {"file too large: 6 bytes"}));
  CHECK_FALSE(files->path_of("/etc/passwd", "t").ok());
  CHECK_FALSE(files->path_of(std::string("a\0b", 3), "t").ok());
  CHECK_FALSE(files->path_of("a\nb", "t").ok());
  CHECK_FALSE(files->path_of("", "t").ok());
  CHECK(*files->path_of("a/../c", "t") == beside.in + "/c");
}

TEST_CASE("pipes as images, masks, flow and tables end at once") {
  const TemporaryFolder folder;
  const auto pipe_at = [&](const std::string& name) {
    fs::create_directories(fs::path(folder / name).parent_path());
    fs::remove(folder / name);
    REQUIRE(::mkfifo((folder / name).c_str(), 0600) == 0);
  };
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 2; ++i) write_images(folder / fmt::format("c{}", i), i, 2);
  write_transforms(folder.path,
                   {"c0/000000.png", "c1/000000.png", "c0/000001.png", "c1/000001.png"}, 2);
  PrepareSettings settings;
  settings.default_test_cameras = false;
  const auto prepared = [&] {
    return prepare(folder.path, folder.path + ".out", settings, {}, {});
  };
  for (const char* name : {"flow/c1/000000.flo", "masks/c1/000000.png", "c1/000000.png",
                           "transforms.json", "train_meta.json", "intri.yml", "poses_bounds.npy"}) {
    INFO(name);
    if (std::string(name).rfind("masks", 0) == 0) write_images(folder / "masks/c1", 0, 2);
    pipe_at(name);
    if (std::string(name) == "intri.yml") pipe_at("extri.yml");
    CHECK_FALSE(prepared().ok());
    if (std::string(name) != "transforms.json") fs::remove(folder / name);
    if (std::string(name).find("/c1/0") != std::string::npos) {
      fs::remove_all(folder / "flow");
      fs::remove_all(folder / "masks");
    }
  }
  CHECK(std::chrono::steady_clock::now() - begin < std::chrono::seconds(60));
}

TEST_CASE("tables that state too many cameras or frames are rejected while they are read") {
  const TemporaryFolder folder;
  const auto rejected = [&](const std::string& name, const std::string& text,
                            const std::vector<std::string>& words) {
    write_text(folder / name, text);
    const Status status = load(folder.path).status();
    INFO(status.message());
    CHECK(fails_with(status, words));
    CHECK(status.code() == StatusCode::kInvalidFile);
    fs::remove(folder / name);
  };
  std::vector<std::string> many;
  for (int i = 0; i < 2000; ++i) many.push_back(fmt::format("c{}/0.png", i));
  write_transforms(folder.path, many);
  CHECK(fails_with(load(folder.path).status(), {"transforms.json", "too many cameras", "1000"}));
  fs::remove(folder / "transforms.json");

  std::string cameras, frames, list;
  for (int i = 0; i < 100'000; ++i) cameras += fmt::format("{}\"c{}\":{{}}", i ? "," : "", i);
  rejected("cameras.json", "{" + cameras + "}", {"too many cameras"});
  for (int i = 0; i < 1'000'001; ++i) frames += i ? ",[]" : "[]";
  rejected("train_meta.json", "{\"fn\":[" + frames + "]}", {"1000001 frames"});
  for (int i = 0; i < 2000; ++i) list += fmt::format("{}0", i ? "," : "");
  rejected("train_meta.json", "{\"fn\":[[" + list + "]]}", {"too many cameras"});
  rejected("train_meta.json",
           "{\"w\":64.5,\"h\":48,\"fn\":[[\"a.png\"]],\"cam_id\":[[0]],"
           "\"k\":[[[1]]],\"w2c\":[[[1]]]}",
           {"\"w\" is 64.5"});
  rejected("train_meta.json",
           "{\"w\":64,\"h\":48,\"fn\":[[\"a.png\"]],\"cam_id\":[[1e300]],"
           "\"k\":[[[1]]],\"w2c\":[[[1]]]}",
           {"\"cam_id\" is 1e+300"});
}

TEST_CASE("decoders are chosen by the first bytes, which must fit the extension") {
  const TemporaryFolder folder;
  for (const char* extension : {"png", "jpg", "bmp", "tif", "webp"}) {
    INFO(extension);
    const std::string path = folder / (std::string("a.") + extension);
    write_image(path, test_image(0, 0));
    const auto files = files_of(folder);
    std::vector<std::uint8_t> bytes = *files->read(path, 1 << 20);
    CHECK(check_image_kind(bytes, path, "w").message().empty());
    CHECK(fails_with(check_image_kind(bytes, "a.gif", "w"), {"not an image by its extension"}));
    const std::string other = extension == std::string("png") ? "a.jpg" : "a.png";
    CHECK(fails_with(check_image_kind(bytes, other, "w"), {"rename it"}));
    bytes.resize(9);
    CHECK_FALSE(check_image_kind(bytes, path, "w").ok());
  }
  const auto video = [](const std::string& text) {
    const std::vector<std::uint8_t> bytes(text.begin(), text.end());
    return check_video_kind(bytes, "a.mp4", "w").ok();
  };
  using namespace std::string_literals;
  CHECK(video("\0\0\0\x18"s + "ftypisom"));
  CHECK(video("\x1a\x45\xdf\xa3\x93\x42\x82\x88matroska"s));
  CHECK(video("RIFF\1\2\3\4AVI LIST"s));
  CHECK_FALSE(video("ffconcat version 1.0\nfile /etc/passwd\n"));
  CHECK_FALSE(video("#EXTM3U\n"));
  CHECK_FALSE(video("    free<MPD dash:profile:isoff-live:2011>"));
  CHECK_FALSE(video("\x1a\x45\xdf\xa3<MPD dash:profile:isoff-live:2011>"s));
  CHECK_FALSE(video("RIFF\1\2\3\4WAVE"));
  CHECK_FALSE(video(""));
}

TEST_CASE("an image header that states too many pixels is rejected before decoding") {
  const TemporaryFolder folder;
  write_image(folder / "a.png", test_image(0, 0));
  std::vector<std::uint8_t> bytes = *files_of(folder)->read(folder / "a.png", 1 << 20);
  bytes[18] = 0x40;  // width and height 16384 + the former
  bytes[22] = 0x40;
  CHECK(check_image_kind(bytes, "a.png", "w").code() == StatusCode::kUnsupported);
  bytes[16] = 1;
  CHECK(check_image_kind(bytes, "a.png", "w").code() == StatusCode::kInvalidFile);
}

// Memory of this process in use, bytes.
std::size_t resident_bytes() {
  std::size_t pages = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> pages >> resident;
  return resident * 4096;
}

TEST_CASE("a TIFF header has sizes of one number, and its tiles are not much larger") {
  using Entry = std::array<std::uint32_t, 4>;  // tag, type, count, value
  constexpr std::uint32_t kShort = 3, kLong = 4, kLong8 = 16;
  const auto status_of = [](const std::vector<Entry>& entries) {
    std::vector<std::uint8_t> bytes = {'I', 'I', '*', 0};
    const auto put = [&](std::uint32_t value, int count) {
      for (int b = 0; b < count; ++b) bytes.push_back(static_cast<std::uint8_t>(value >> (8 * b)));
    };
    put(8, 4);
    put(static_cast<std::uint32_t>(entries.size()), 2);
    for (const auto& [tag, type, count, value] : entries) {
      put(tag, 2), put(type, 2), put(count, 4), put(value, 4);
    }
    return check_image_kind(bytes, "a.tif", "w");
  };
  const Entry width = {256, kShort, 1, 64}, height = {257, kShort, 1, 16};
  const auto tiled = [&](std::uint32_t w, std::uint32_t h) {
    return status_of({width, height, {322, kShort, 1, w}, {323, kLong, 1, h}});
  };
  CHECK(status_of({width, {257, kLong, 1, 16}}).ok());
  // The value of a LONG8 is elsewhere in the file.
  CHECK(fails_with(status_of({{256, kLong8, 1, 64}, height}), {"a.tif", "header"}));
  CHECK(fails_with(status_of({{256, kShort, 2, 64}, height}), {"header"}));
  CHECK(tiled(512, 512).ok());
  CHECK_FALSE(tiled(16, 1u << 22).ok());
  CHECK_FALSE(tiled(0, 16).ok());
  // Strips of more bytes than the file has.
  CHECK(status_of({width, height, {279, kLong, 1, 1'000'000}}).ok());
  CHECK_FALSE(status_of({width, height, {279, kLong, 1, 2'000'000}}).ok());
  CHECK_FALSE(status_of({width, height, {279, kLong8, 1, 10}}).ok());
}

TEST_CASE("the plans of distorted cameras take no memory per pixel") {
  const std::size_t before = resident_bytes();
  std::vector<CameraPlan> plans;
  for (const LensModel lens : {LensModel::kOpenCv, LensModel::kFisheye}) {
    SourceCamera camera;
    camera.name = "lens";
    camera.fx = camera.fy = 6000;
    camera.cx = 4096;
    camera.cy = 3072;
    camera.lens = lens;
    camera.distortion = {-0.1, 0.01, 0, 0};
    auto plan = plan_camera(camera, {8192, 6144, 1, 0}, 1);
    REQUIRE(plan.ok());
    plans.push_back(*std::move(plan));
    CHECK_FALSE(plans.back().is_identity());
  }
  CHECK(resident_bytes() < before + (std::size_t{200} << 20));  // the maps have 403 MB each
}

TEST_CASE("a program is stopped at its deadline, with its children") {
  const TemporaryFolder folder;
  const std::string script = fmt::format("sleep 300 & echo $! > {}/child; wait", folder.path);
  const auto begin = std::chrono::steady_clock::now();
  const Status status = run_program({"sh", "-c", script}, folder / "log", "test", 0, {},
                                    begin + std::chrono::milliseconds(500));
  CHECK(fails_with(status, {"time limit"}));
  CHECK(std::chrono::steady_clock::now() - begin < std::chrono::seconds(30));
  std::string pid;
  std::ifstream(folder / "child") >> pid;
  REQUIRE_FALSE(pid.empty());
  const auto is_alive = [&] {
    std::string line;
    std::ifstream status_file("/proc/" + pid + "/status");
    while (std::getline(status_file, line)) {
      if (line.rfind("State:", 0) == 0) return line.find('Z') == std::string::npos;
    }
    return false;
  };
  for (int i = 0; i < 100 && is_alive(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  CHECK_FALSE(is_alive());
}

TEST_CASE("the reason of a failure is found at the end of a log of any size") {
  const TemporaryFolder folder;
  write_text(folder / "log", std::string(5 << 20, 'x') + "\nERROR: the reason\n");
  CHECK(failure_reason(folder / "log") == ": the reason");
}

}  // namespace
}  // namespace stgs::encoder::capture_test
