// SPDX-License-Identifier: Apache-2.0
// Rounds: windows that several processes train against the same persistent set.
#include "stream/round.h"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>

#include "catch.h"
#include "fixtures/played_psnr.h"
#include "fixtures/synthetic_capture.h"
#include "fixtures/train_run.h"
#include "stgs/encoder/stream_worker.h"
#include "stgs/encoder/windows.h"
#include "train/train_state.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::SyntheticCapture;

namespace fs = std::filesystem;

namespace {

using Ends = std::vector<std::vector<MemberEnd>>;
using Members = std::vector<std::uint32_t>;

constexpr int kFrames = 18, kWindow = 6;
constexpr std::uint32_t kAlways = 1000;  // a frame after every window

// Returns until which frame of each window a member is displayed, as the plans have it. A stored
// copy is displayed until its end.
std::vector<std::uint32_t> displayed(const std::vector<WindowPlan>& plans, std::uint32_t member) {
  std::vector<std::uint32_t> out;
  bool stored = true;
  for (const WindowPlan& plan : plans) {
    std::uint32_t until = stored ? kAlways : 0;
    for (const MemberEnd& end : plan.ends) {
      if (end.member != member) continue;
      REQUIRE(stored);
      stored = false;
      until = end.frame;
    }
    for (const std::uint32_t again : plan.stored_again) {
      if (again != member) continue;
      REQUIRE_FALSE(stored);
      stored = true;
      until = kAlways;
    }
    for (const MemberEnd& end : plan.displayed_again) {
      if (end.member != member) continue;
      REQUIRE_FALSE(stored);
      until = end.frame;
    }
    out.push_back(until);
  }
  return out;
}

StreamSettings settings_of() {
  StreamSettings settings;
  settings.train = test::short_run(240);
  settings.identity = "a test";
  return settings;
}

PreparedCapture window_of(const SyntheticCapture& synthetic, int index) {
  const auto window = extract_window(synthetic.capture, {index * kWindow, (index + 1) * kWindow});
  REQUIRE(window.ok());
  return *window;
}

// An encoder whose first window is recorded, and a worker in the same folder.
struct Processes {
  std::string folder;
  std::unique_ptr<StreamEncoder> encoder;
  std::unique_ptr<StreamWorker> worker;

  Processes(const SyntheticCapture& synthetic, const std::string& name)
      : folder(synthetic.capture.folder + "/" + name) {
    fs::create_directory(folder);
    open();
    REQUIRE(encoder->encode(window_of(synthetic, 0), nullptr, nullptr).ok());
  }

  void open() {
    encoder.reset();
    auto opened = StreamEncoder::open(folder, settings_of());
    REQUIRE(opened.ok());
    encoder = std::move(*opened);
    auto other = StreamWorker::open(folder, settings_of());
    REQUIRE(other.ok());
    worker = std::move(*other);
  }

  // Trains the second and the third window, the latter in the worker.
  std::vector<TrainedWindow> train(const SyntheticCapture& synthetic) {
    std::vector<TrainedWindow> round(2);
    auto second = encoder->train_window(window_of(synthetic, 1), nullptr, nullptr);
    REQUIRE(second.ok());
    round[0] = std::move(*second);
    const auto third =
        worker->train_window(window_of(synthetic, 2), {kWindow, 3 * kWindow}, nullptr, nullptr);
    INFO(third.status().message());
    REQUIRE(third.ok());
    const std::string path = folder + "/trained";
    REQUIRE(write_trained_window(path, *third, true).ok());
    auto read = read_trained_window(path, true);
    INFO(read.status().message());
    REQUIRE(read.ok());
    remove_trained_window(path);
    round[1] = std::move(*read);
    return round;
  }

  std::string finish(const std::string& name) {
    const std::string output = folder + "-" + name + ".stgs";
    REQUIRE(encoder->finish(output).ok());
    return output;
  }
};

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

}  // namespace

TEST_CASE("a round of one window ends the stored members, and stores none again") {
  const auto plans = plan_round(4, Ends{{{1, 5}, {3, 0}}});
  REQUIRE(plans.size() == 1);
  CHECK(plans[0].ends == std::vector<MemberEnd>{{1, 5}, {3, 0}});
  CHECK(plans[0].stored_again.empty());
  CHECK(plans[0].displayed_again.empty());
}

TEST_CASE("a member that one window ends and a later one displays is stored again") {
  const auto plans = plan_round(4, Ends{{{1, 5}, {2, 3}, {3, 1}}, {{2, 4}, {3, 0}}, {}});
  REQUIRE(plans.size() == 3);
  CHECK(plans[1].ends.empty());
  CHECK(plans[1].stored_again == Members{1});
  // Member 3 is not displayed in any frame of the second window.
  CHECK(plans[1].displayed_again == std::vector<MemberEnd>{{2, 4}});
  CHECK(plans[2].stored_again == Members{2, 3});
  CHECK(plans[2].displayed_again.empty());
}

TEST_CASE("a copy that was stored again ends where it is stored") {
  const auto plans = plan_round(1, Ends{{{0, 5}}, {}, {{0, 2}}});
  CHECK(plans[1].stored_again == Members{0});
  CHECK(plans[2].ends == std::vector<MemberEnd>{{0, 2}});
  CHECK(plans[2].displayed_again.empty());
}

TEST_CASE("every window displays every member as it was trained") {
  std::mt19937 random(3);
  for (int run = 0; run < 200; ++run) {
    const auto members = static_cast<std::uint32_t>(1 + random() % 6);
    Ends ends(1 + random() % 5);
    for (std::vector<MemberEnd>& window : ends) {
      for (std::uint32_t m = 0; m < members; ++m)
        if (random() % 3 == 0) window.push_back({m, static_cast<std::uint32_t>(random() % 4)});
    }
    const auto plans = plan_round(members, ends);
    for (std::uint32_t m = 0; m < members; ++m) {
      std::vector<std::uint32_t> expected;
      for (const std::vector<MemberEnd>& window : ends) {
        expected.push_back(kAlways);
        for (const MemberEnd& end : window)
          if (end.member == m) expected.back() = end.frame;
      }
      CHECK(displayed(plans, m) == expected);
    }
  }
}

TEST_CASE(
    "windows of a round look as good as windows in sequence, and an interrupted one is repeated") {
  const SyntheticCapture synthetic(4, kFrames);
  Processes processes(synthetic, "round");
  const auto recorded = processes.encoder->append(processes.train(synthetic));
  INFO(recorded.status().message());
  REQUIRE(recorded.ok());
  REQUIRE(recorded->size() == 2);
  CHECK((*recorded)[1].first_frame == 2 * kWindow);
  CHECK((*recorded)[1].training.iterations == 120);
  CHECK((*recorded)[0].persistent == processes.encoder->persistent());
  CHECK(processes.encoder->frames() == kFrames);
  const std::string set = processes.folder + "/persistent-0000018.set";
  CHECK(fs::exists(set));
  const std::string output = processes.finish("once");

  const Processes sequence(synthetic, "sequence");
  for (const int k : {1, 2})
    REQUIRE(sequence.encoder->encode(window_of(synthetic, k), nullptr, nullptr).ok());
  const std::string in_sequence = sequence.folder + ".stgs";
  REQUIRE(sequence.encoder->finish(in_sequence).ok());
  const double found = test::mean_of(test::psnr_by_frame(output, synthetic.capture)),
               expected = test::mean_of(test::psnr_by_frame(in_sequence, synthetic.capture));
  CAPTURE(found, expected);
  CHECK(found > expected - 0.3);

  // Killed after the first fragment of the round: it has no set, and is repeated as a whole.
  Processes killed(synthetic, "killed");
  const std::string before = killed.folder + "/persistent-0000006.set";
  fs::copy_file(before, killed.folder + "-kept");
  std::vector<TrainedWindow> round = killed.train(synthetic);
  round.pop_back();
  REQUIRE(killed.encoder->append(std::move(round)).ok());
  fs::rename(killed.folder + "-kept", before);
  fs::remove(killed.folder + "/persistent-0000012.set");
  killed.open();
  CHECK(killed.encoder->frames() == kWindow);
  REQUIRE(killed.encoder->append(killed.train(synthetic)).ok());
  CHECK(bytes_of(killed.finish("again")) == bytes_of(output));
}

TEST_CASE("a member that a window of a round ends remains for the later ones") {
  const SyntheticCapture synthetic(4, kFrames);
  Processes processes(synthetic, "ends");
  std::vector<TrainedWindow> round = processes.train(synthetic);
  REQUIRE(round[0].set.ends().empty());
  REQUIRE(round[1].set.ends().empty());
  const std::string copy = processes.folder + "-copy";
  fs::copy(processes.folder, copy, fs::copy_options::recursive);
  const auto without_ends = StreamEncoder::open(copy, settings_of());
  REQUIRE(without_ends.ok());
  const auto expected = (*without_ends)->append(round);
  REQUIRE(expected.ok());
  // Not displayed from frame 3 of the second window on, but in the third.
  round[0].set.set_ends({{0, 3}, {1, 3}, {2, 3}});
  const auto recorded = processes.encoder->append(std::move(round));
  REQUIRE(recorded.ok());
  CHECK((*recorded)[0].ended == 3);
  CHECK((*recorded)[0].primitives == (*expected)[0].primitives);
  CHECK((*recorded)[1].primitives == (*expected)[1].primitives + 3);
  CHECK(processes.encoder->persistent() == (*without_ends)->persistent());
  const auto scene = read_scene(processes.finish("scene"));
  REQUIRE(scene.ok());
  std::uint64_t lasting = 0;
  for (const ScenePart& part : scene->parts)
    lasting += part.displayed_range().end > kFrames ? part.primitives : 0;
  CHECK(lasting == processes.encoder->persistent() + 3);  // also where they were stored first

  // A window cannot end a primitive that the set lacks.
  Processes other(synthetic, "other");
  std::vector<TrainedWindow> bad = other.train(synthetic);
  bad[1].set.set_ends({{static_cast<std::uint32_t>(other.encoder->persistent()), 1}});
  CHECK(other.encoder->append(std::move(bad)).status().code() == StatusCode::kInvalidFile);
}

TEST_CASE("a trained window that is damaged or of other settings is refused") {
  const SyntheticCapture synthetic(4, kFrames);
  Processes processes(synthetic, "files");
  const auto trained = processes.worker->train_window(window_of(synthetic, 1),
                                                      {kWindow, 2 * kWindow}, nullptr, nullptr);
  REQUIRE(trained.ok());
  const std::string path = processes.folder + "/trained";
  REQUIRE(write_trained_window(path, *trained, false).ok());
  CHECK_FALSE(fs::exists(path + ".state"));
  const auto read = read_trained_window(path, false);
  REQUIRE(read.ok());
  CHECK(read->scene.gaussians.position == trained->scene.gaussians.position);
  CHECK(read->scene.parts == trained->scene.parts);
  CHECK(read->scene.quantisation == trained->scene.quantisation);
  CHECK(read->scene.importance == trained->scene.importance);
  CHECK(read->training.iterations == 120);
  CHECK(read_trained_window(path, true).status().code() == StatusCode::kIo);
  const std::string bytes = bytes_of(path);
  for (const std::size_t length : {std::size_t{0}, std::size_t{20}, bytes.size() - 1}) {
    std::ofstream(path, std::ios::binary) << bytes.substr(0, length);
    CHECK(read_trained_window(path, false).status().code() == StatusCode::kInvalidFile);
  }
  StreamSettings other = settings_of();
  other.identity = "another";
  CHECK(StreamWorker::open(processes.folder, other).status().code() == StatusCode::kUsage);
}
