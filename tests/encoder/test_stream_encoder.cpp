// SPDX-License-Identifier: Apache-2.0
// Captures encoded window by window: static content is stored once, and an interrupted run resumes.
#include "stgs/encoder/stream_encoder.h"

#include <filesystem>
#include <iterator>

#include "catch.h"
#include "fixtures/played_psnr.h"
#include "fixtures/synthetic_capture.h"
#include "fixtures/train_run.h"
#include "stgs/encoder/windows.h"
#include "train/train_state.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::SyntheticCapture;

namespace {

constexpr int kFrames = 18, kWindow = 6;

StreamSettings settings_of(const std::string& identity = "a test") {
  StreamSettings settings;
  settings.train = test::short_run(240);
  settings.later_share = 0.5;
  settings.title = "Windows";
  settings.identity = identity;
  return settings;
}

std::unique_ptr<StreamEncoder> open(const std::string& folder, const StreamSettings& settings) {
  auto encoder = StreamEncoder::open(folder, settings);
  INFO(encoder.status().message());
  REQUIRE(encoder.ok());
  return std::move(*encoder);
}

StreamWindow encode_next(StreamEncoder& encoder, const PreparedCapture& complete) {
  const int begin = encoder.frames();
  const auto window = extract_window(complete, {begin, begin + kWindow});
  REQUIRE(window.ok());
  const auto encoded = encoder.encode(*window, nullptr, nullptr);
  INFO(encoded.status().message());
  REQUIRE(encoded.ok());
  CHECK(encoder.frames() == begin + kWindow);
  return *encoded;
}

auto count_files(const std::string& folder) {
  return std::distance(std::filesystem::directory_iterator(folder), {});
}

std::string new_folder(const SyntheticCapture& synthetic, const std::string& name) {
  const std::string folder = synthetic.capture.folder + "/" + name;
  std::filesystem::create_directory(folder);
  return folder;
}

}  // namespace

TEST_CASE("a folder without a complete window starts any run") {
  const SyntheticCapture synthetic(4, kFrames);
  const std::string folder = new_folder(synthetic, "folder");
  (void)open(folder, settings_of());
  encode_next(*open(folder, settings_of("another")), synthetic.capture);
  CHECK(StreamEncoder::open(folder, settings_of()).status().code() == StatusCode::kUsage);
  // A run that was killed while it removed its folder can leave its set.
  std::filesystem::remove(folder + "/recording.stgs");
  CHECK(open(folder, settings_of())->frames() == 0);
  CHECK_FALSE(std::filesystem::exists(folder + "/persistent-0000006.set"));
  encode_next(*open(folder, settings_of()), synthetic.capture);
  CHECK(open(folder, settings_of())->frames() == kWindow);
}

TEST_CASE("windows share static content, and an interrupted encoding resumes to the same bytes") {
  const SyntheticCapture synthetic(4, kFrames);
  const PreparedCapture& complete = synthetic.capture;
  const std::string once = new_folder(synthetic, "once"), twice = new_folder(synthetic, "twice");
  const std::string output = complete.folder + "/once.stgs",
                    again = complete.folder + "/twice.stgs";
  std::vector<StreamWindow> windows;
  {
    const auto encoder = open(once, settings_of());
    CHECK(encoder->finish(output).code() == StatusCode::kUsage);
    while (encoder->frames() < kFrames) {
      windows.push_back(encode_next(*encoder, complete));
      CHECK(count_files(once) == 4);  // identity, bounds, persistent set and recording
    }
    REQUIRE(encoder->finish(output).ok());
  }
  REQUIRE(windows.size() == 3);
  CHECK(windows[0].training.iterations == 240);
  CHECK(windows[1].training.iterations == 120);
  CHECK(windows[1].first_frame == kWindow);
  CHECK(windows[0].persistent > 50);
  CHECK(windows[2].persistent >= windows[0].persistent);
  CHECK(windows[1].primitives < windows[0].primitives);

  const auto scene = read_scene(output);
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == kFrames);
  CHECK(scene->metadata.title == "Windows");
  CHECK_FALSE(scene->metadata.window);
  std::uint64_t lasting = 0;
  for (const ScenePart& part : scene->parts)
    lasting += part.displayed_range().end > kFrames ? part.primitives : 0;
  CHECK(lasting == windows[2].persistent);

  // Resumes after every window, and once before the first.
  for (int k = 0; k < 3; ++k) {
    (void)open(twice, settings_of());
    encode_next(*open(twice, settings_of()), complete);
    // A killed process can leave another set.
    std::filesystem::copy(fmt::format("{}/persistent-{:07}.set", twice, (k + 1) * kWindow),
                          twice + "/persistent-0000001.set");
  }
  // Of a run that was killed between a fragment and its set, the fragment is encoded again.
  const std::string thrice = new_folder(synthetic, "thrice"), last = complete.folder + "/last.stgs";
  for (int k = 0; k < 2; ++k) encode_next(*open(thrice, settings_of()), complete);
  namespace fs = std::filesystem;
  const std::string before = thrice + "/persistent-0000012.set";
  fs::copy_file(before, thrice + "/kept");
  encode_next(*open(thrice, settings_of()), complete);
  fs::remove(thrice + "/persistent-0000018.set");
  fs::rename(thrice + "/kept", before);
  CHECK(open(thrice, settings_of())->frames() == 2 * kWindow);
  encode_next(*open(thrice, settings_of()), complete);
  REQUIRE(open(thrice, settings_of())->finish(last).ok());
  CHECK(StreamEncoder::open(twice, settings_of("another")).status().code() == StatusCode::kUsage);
  StreamSettings other = settings_of();
  other.train.seed = 5;
  CHECK(StreamEncoder::open(twice, other).status().code() == StatusCode::kUsage);
  REQUIRE(open(twice, settings_of())->finish(again).ok());
  CHECK(count_files(twice) == 4);
  const auto bytes = [](const std::string& path) {
    const auto file = open_file(path);
    REQUIRE(file.ok());
    std::vector<std::uint8_t> out((*file)->size());
    REQUIRE((*file)->read(0, out).ok());
    return out;
  };
  CHECK(bytes(output) == bytes(again));
  CHECK(bytes(output) == bytes(last));

  const auto whole = train(complete, test::short_run(240), nullptr, nullptr, nullptr);
  REQUIRE(whole.ok());
  REQUIRE(write_scene(again, *whole, {}).ok());
  const std::vector<double> found = test::psnr_by_frame(output, complete);
  const std::vector<double> expected = test::psnr_by_frame(again, complete);
  double worst = 100;  // next to the boundaries of windows
  for (const std::size_t f : {5, 6, 11, 12}) worst = std::min(worst, found[f]);
  CAPTURE(test::mean_of(found), test::mean_of(expected), worst);
  CHECK(test::mean_of(found) > test::mean_of(expected) - 0.5);
  CHECK(worst > test::mean_of(found) - 0.5);
}

TEST_CASE("later windows leave the stored primitives as they are, to the bit") {
  const SyntheticCapture synthetic(4, kFrames);
  const auto first = extract_window(synthetic.capture, {0, kWindow}),
             second = extract_window(synthetic.capture, {kWindow, 2 * kWindow});
  PersistentSet set;
  TrainSettings settings = test::short_run(240);
  settings.refine_cameras = true;  // which changes more of the state
  REQUIRE(train(*first, settings, nullptr, nullptr, nullptr, {&set, nullptr}).ok());
  const TrainState before = *set.state();
  REQUIRE(before.count_fixed() > 50);
  const std::string path = synthetic.capture.folder + "/a.set";
  set.set_recorded({std::vector<StoredPrimitive>(set.size(), {7, 1}), 100});
  REQUIRE(set.write(path).ok());
  auto read = PersistentSet::read(path);
  INFO(read.status().message());
  REQUIRE(read.ok());
  CHECK(read->recorded().primitives == set.recorded().primitives);
  CHECK(read->recorded().bytes == 100);
  REQUIRE(train(*second, settings, nullptr, nullptr, nullptr, {&*read, nullptr}).ok());
  const TrainState& after = *read->state();
  REQUIRE(after.size() >= before.count_fixed());
  for (std::size_t i = 0; i < before.count_fixed(); ++i) CHECK(after.is_fixed(i));
  for (int a = 0; a < kAttributes; ++a) {
    const FloatArray &x = before.values(a), &y = after.values(a);
    const auto n = before.count_fixed() * static_cast<std::size_t>(before.components(a));
    INFO(a);
    CHECK(std::equal(x.begin(), x.begin() + static_cast<std::ptrdiff_t>(n), y.begin()));
  }
  settings.overrides.emplace_back("sh_degree", "2");
  CHECK(train(*second, settings, nullptr, nullptr, nullptr, {&*read, nullptr}).status().code() ==
        StatusCode::kInvalidFile);
}

TEST_CASE("a window without motion adds nothing, and methods without static content are refused") {
  const SyntheticCapture synthetic(4, kFrames);
  REQUIRE(write_points(synthetic.capture.folder + "/points_dynamic.ply", {}).ok());
  const std::string folder = new_folder(synthetic, "work");
  const auto encoder = open(folder, settings_of());
  CHECK(encode_next(*encoder, synthetic.capture).primitives > 0);
  const StreamWindow second = encode_next(*encoder, synthetic.capture);
  REQUIRE(encoder->finish(synthetic.capture.folder + "/still.stgs").ok());
  const auto scene = read_scene(synthetic.capture.folder + "/still.stgs");
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == 2 * kWindow);
  CAPTURE(second.primitives);
  StreamSettings settings = settings_of();
  settings.train.ablate = "representation";
  const std::string other = new_folder(synthetic, "other");
  CHECK(StreamEncoder::open(other, settings).status().code() == StatusCode::kUsage);
  settings = settings_of();
  settings.pack.profile = Profile::kNearLossless;
  CHECK(StreamEncoder::open(other, settings).status().code() == StatusCode::kUsage);
  CHECK(StreamEncoder::open(synthetic.capture.folder, settings_of()).status().code() ==
        StatusCode::kUsage);
}

TEST_CASE("a cancelled window leaves the recording as it was") {
  const SyntheticCapture synthetic(4, kFrames);
  const std::string folder = new_folder(synthetic, "work");
  const auto encoder = open(folder, settings_of());
  encode_next(*encoder, synthetic.capture);
  const auto size = std::filesystem::file_size(folder + "/recording.stgs");
  const auto window = extract_window(synthetic.capture, {kWindow, 2 * kWindow});
  const auto cancel = [](const Progress& progress) { return progress.stage != "train"; };
  CHECK(encoder->encode(*window, cancel, nullptr).status().code() == StatusCode::kRuntime);
  CHECK(encoder->frames() == kWindow);
  CHECK(std::filesystem::file_size(folder + "/recording.stgs") == size);
  encode_next(*encoder, synthetic.capture);
}
