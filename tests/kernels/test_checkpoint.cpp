// SPDX-License-Identifier: Apache-2.0
// Checkpoints, and the fingerprints that match them to a training run.
#include "train/checkpoint.h"

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "catch.h"
#include "fixtures/temporary_folder.h"
#include "random_train_state.h"
#include "train/fingerprint.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

TEST_CASE("a checkpoint restores every number, and a damaged one is rejected") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "run.ckpt";
  TrainState state = random_train_state(5, 9);
  state.iteration = 77;
  state.seconds = 1.5;
  state.moments[kSh].second[3] = 0.25f;
  state.colour[1][4] = 0.75f;
  const Fingerprint fingerprint = {{"seed", "3"}, {"camera \"left\"", "640x360"}};
  REQUIRE(write_checkpoint(path, state, fingerprint).ok());
  const Result<Checkpoint> restored = read_checkpoint(path);
  REQUIRE(restored.ok());
  CHECK(restored->fingerprint == fingerprint);
  CHECK(restored->state.iteration == 77);
  CHECK(restored->state.set.sh == state.set.sh);
  CHECK(restored->state.moments[kSh].second == state.moments[kSh].second);
  CHECK(restored->state.colour == state.colour);

  std::ifstream in(path, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  for (std::size_t at = 0; at < bytes.size(); at += 41) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x10);
    std::ofstream(path, std::ios::binary) << damaged;
    CHECK(read_checkpoint(path).status().code() == StatusCode::kInvalidFile);
  }
  std::ofstream(path, std::ios::binary) << bytes.substr(0, bytes.size() / 2);
  CHECK(read_checkpoint(path).status().code() == StatusCode::kInvalidFile);
  std::remove(path.c_str());
}

TEST_CASE("a checkpoint of another version is reported as unsupported, other files as invalid") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "run.ckpt";
  REQUIRE(write_checkpoint(path, random_train_state(2, 9), {}).ok());
  std::ifstream in(path, std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  for (const char version : {'7', '9'}) {
    bytes[7] = version;
    std::ofstream(path, std::ios::binary) << bytes;
    const Status status = read_checkpoint(path).status();
    CHECK(status.code() == StatusCode::kUnsupported);
    CHECK(status.message().find("another version of stgs; resume with") != std::string::npos);
  }
  bytes[6] = 'Q';
  std::ofstream(path, std::ios::binary) << bytes;
  CHECK(read_checkpoint(path).status().code() == StatusCode::kInvalidFile);
  std::remove(path.c_str());
}

TEST_CASE("a capture with reordered or missing cameras does not match") {
  PreparedCapture capture;
  capture.cameras.resize(3);
  for (std::size_t i = 0; i < 3; ++i) capture.cameras[i].name = std::string(1, "abc"[i]);
  const Fingerprint all = fingerprint_of(capture);
  std::swap(capture.cameras[0], capture.cameras[2]);
  const std::string swapped = check_same_run("k", all, fingerprint_of(capture)).message();
  CHECK(swapped.find("camera a: number 1") != std::string::npos);
  capture.cameras[0].test = true;
  const std::string fewer = check_same_run("k", all, fingerprint_of(capture)).message();
  CHECK(fewer.find("training cameras: 3, now 2") != std::string::npos);
}

TEST_CASE("a capture whose images were replaced does not match") {
  PreparedCapture capture;
  const testing::TemporaryFolder folder;
  capture.folder = folder.path;
  capture.frames = 2;
  capture.cameras.resize(1);
  capture.cameras[0].name = std::string(1, 'a');
  for (int frame = 0; frame < 2; ++frame) {
    const std::filesystem::path path = capture.frame_path(capture.cameras[0], frame);
    std::filesystem::create_directories(path.parent_path());
    std::ofstream(path) << "image " << frame;
  }
  const Fingerprint before = image_fingerprint(capture);
  CHECK(check_same_run("k", before, image_fingerprint(capture)).ok());
  std::ofstream(capture.frame_path(capture.cameras[0], 1)) << "another image";
  CHECK(check_same_run("k", before, image_fingerprint(capture))
            .message()
            .find("images of camera a") != std::string::npos);
}

TEST_CASE("differences between two runs are listed with both values") {
  const Fingerprint found = {
      {"seed", "1"}, {"iterations", "30"}, {"frames", "6"}, {"backend", "cuda"}};
  CHECK(check_same_run("a.ckpt", found, found).ok());
  // Neither missing entries nor another backend are differences.
  CHECK(check_same_run("a.ckpt", found, {{"iterations", "30"}, {"backend", "cpu"}}).ok());
  const Status other =
      check_same_run("a.ckpt", found, {{"seed", "2"}, {"iterations", "30"}, {"camera b", "4x3"}});
  CHECK(other.code() == StatusCode::kUsage);
  const std::string& message = other.message();
  CHECK(message.find("a.ckpt: ") == 0);
  CHECK(message.find(": seed: 1, now 2; camera b: missing, now 4x3") != std::string::npos);
  CHECK(message.find("iterations") == std::string::npos);
  Fingerprint many;
  for (int i = 0; i < 40; ++i) many.emplace_back(fmt::format("p{}", i), "0");
  CHECK(check_same_run("a", {}, many).message().find("and 28 more") != std::string::npos);
}
