// SPDX-License-Identifier: Apache-2.0
#include "fourdgs_reading.h"

using namespace stgs;
using namespace stgs::testing::fourdgs;
using Catch::Contains;

namespace {

// Never fades, in the window of the clip. Its size is e^0, so tolerances are 0.02 scene units.
Gaussian solid(std::uint32_t id, int x) {
  Gaussian g;
  g.position = {x, 0, 0};
  g.flags = 1;
  g.id = id;
  return g;
}

// Chunks of one second, one after the other, with their index entries.
class Clip {
 public:
  Clip() {
    file.model = "keyframe-delta";
    file.duration = 0;
    file.windows = {{0, 100}};
  }

  void add_keyframe(const std::vector<Gaussian>& set, int degree = 0) {
    keyframe_ = end();
    depth_ = 0;
    add(chunk(file.duration, file.duration + 1, set.size(), streams(set, true)));
    file.body += bands(set, degree);
  }
  // Refers to the chunk before it, or to the keyframe.
  void add_delta(Delta d, bool chained = true) {
    d.begin = file.duration;
    d.end = file.duration + 1;
    d.mode = chained ? 1 : 0;
    d.keyframe = keyframe_;
    d.reference = chained ? last_ : keyframe_;
    d.depth = depth_ = chained ? depth_ + 1 : 1;
    add(delta_chunk(d));
  }

  // The offset at which the next chunk begins. Records in front have fixed sizes.
  std::uint64_t end() const { return file.head().size() + file.body.size(); }
  std::uint64_t last() const { return last_; }

  File file;

 private:
  void add(const std::string& text) {
    last_ = end();
    file.body += text;
    file.duration += 1;
  }

  std::uint64_t keyframe_ = 0, last_ = 0;
  int depth_ = 0;
};

// The x coordinates of the primitives visible in the middle of second `t`, ascending.
std::vector<double> visible_at(const Scene& scene, double seconds) {
  const auto set = snapshot_at(scene, scene.metadata.time_base.ticks(seconds));
  REQUIRE(set.ok());
  std::vector<double> out;
  for (std::size_t i = 0; i < set->size(); ++i) out.push_back(set->position[3 * i]);
  std::sort(out.begin(), out.end());
  return out;
}

Delta moving(const std::vector<Gaussian>& which, const std::vector<int>& steps) {
  Delta d;
  d.updated = which;
  d.update_streams = stream(0, 3, steps);
  return d;
}

}  // namespace

TEST_CASE("4dgs: keyframes, updates, births and deaths are composed by identity") {
  Clip clip;
  // Not in the order of their identities.
  clip.add_keyframe({solid(9, 8), solid(2, 0), solid(5, 4)});
  Delta first = moving({solid(5, 0)}, {2, 0, 0});  // 5: 4 -> 6
  first.born = {solid(7, 20)};
  first.dead = {solid(2, 0)};
  clip.add_delta(first);
  clip.add_delta(moving({solid(7, 0), solid(9, 0)}, {1, 0, 0, -2, 0, 0}));
  // Refers to the keyframe, in which 2 exists and 7 does not.
  clip.add_delta(moving({solid(2, 0)}, {-2, 0, 0}), false);
  clip.add_keyframe({solid(9, 8)});
  ConversionNotes notes;
  const Scene scene = read_valid(clip.file.bytes(), &notes);
  CHECK(notes.empty());
  CHECK(scene.metadata.time_base == TimeBase{1, 24});  // divides a second, at least 24 per second
  CHECK(scene.metadata.frames == 5 * 24);
  // The step of positions is 0.5, from 1.
  CHECK(visible_at(scene, 0.5) == std::vector<double>{1, 3, 5});
  CHECK(visible_at(scene, 1.5) == std::vector<double>{4, 5, 11});
  CHECK(visible_at(scene, 2.5) == std::vector<double>{4, 4, 11.5});
  CHECK(visible_at(scene, 3.5) == std::vector<double>{0, 3, 5});
  CHECK(visible_at(scene, 4.5) == std::vector<double>{5});
  // Visible at the first and the last frame of a state, and not beyond.
  CHECK(visible_at(scene, 1 - 1.0 / 24).size() == 3);
  CHECK(visible_at(scene, 4.0).size() == 1);
}

TEST_CASE("4dgs: a Gaussian that states its motion consistently becomes one primitive") {
  Clip clip;
  Gaussian g = solid(1, 0);
  // A window of more than 2 s: the step of the velocity is 0.4 / 4. It moves by 0.5 per second.
  g.motion = {5, 0, 0};
  clip.add_keyframe({g, solid(4, 10)});
  for (int i = 1; i < 4; ++i) {
    Delta d = moving({g}, {1, 0, 0});
    d.update_streams += stream(7, 1, {10});  // by 1 s
    clip.add_delta(d);
  }
  FourdgsReport report;
  const auto scene = read(clip.file.bytes(), nullptr, &report);
  REQUIRE(scene.ok());
  const Gaussians4D& set = scene->gaussians;
  REQUIRE(set.size() == 2);
  CHECK(coordinate(set, 0, 0, 0) == Approx(1).margin(0.02));
  CHECK(coordinate(set, 0, 0, 4 * 24) == Approx(3).margin(0.02));
  CHECK(set.velocity[3] == 0);
  REQUIRE(report.sequence);
  CHECK(report.sequence->frames == 96);
  CHECK(report.sequence->splats == 2 * 96);
  CHECK(report.sequence->first_frame_splats == 2);
  CHECK(report.sequence->whole_clip == 2);
  CHECK(report.sequence->moving == 1);
  CHECK(report.sequence->matched() == 1);
}

TEST_CASE("4dgs: Gaussians that swap places keep their identities") {
  Clip clip;
  Gaussian red = solid(1, 0), green = solid(2, 10);
  red.colour = {0, 20, 0};
  green.colour = {20, -20, -20};
  clip.add_keyframe({red, green});
  std::swap(red.position, green.position);
  clip.add_keyframe({green, red});
  FourdgsSettings settings;
  settings.frame_time = {1, 1};
  const auto scene = read(clip.file.bytes(), nullptr, nullptr, settings);
  REQUIRE(scene.ok());
  const Gaussians4D& set = scene->gaussians;
  // At one frame per second, both move along lines.
  REQUIRE(set.size() == 2);
  CHECK(set.velocity[0] == Approx(5).margin(0.03));
  CHECK(set.velocity[3] == Approx(-5).margin(0.03));
}

TEST_CASE("4dgs: fades and windows of states are sampled at the frames") {
  Clip clip;
  Gaussian fade = solid(1, 0);
  fade.flags = 0;
  Gaussian late = solid(2, 4);
  late.window = 1;
  clip.file.windows = {{0, 100}, {0.5, 0.75}};
  clip.add_keyframe({fade, late});
  const Scene scene = read_valid(clip.file.bytes());
  const auto at = [&](int frame) { return *snapshot_at(scene, frame); };
  for (int frame = 0; frame < 24; frame += 5) {
    const Gaussians4D set = at(frame);
    const double x = frame / 24.0;
    const std::size_t i = set.position[0] == 1.0f ? 0 : 1;
    CHECK(opacity(set, i) == Approx(0.8 * std::exp(-0.5 * x * x)).margin(0.004));
  }
  CHECK(at(11).size() == 1);
  CHECK(at(12).size() == 2);
  CHECK(at(17).size() == 2);
  CHECK(at(18).size() == 1);
}

TEST_CASE("4dgs: SH of keyframes and births") {
  Clip clip;
  clip.file.sh_degree = 1;
  Gaussian a = solid(3, 0), b = solid(1, 4), c = solid(2, 8);
  a.sh.assign(9, 0);
  b.sh.assign(9, 255);
  c.sh.assign(9, 51);
  clip.add_keyframe({a, b}, 1);
  Delta d;
  d.born = {c};
  clip.add_delta(d);
  clip.file.body += bands({c}, 1);
  const Scene scene = read_valid(clip.file.bytes());
  const auto set = snapshot_at(scene, 36);
  REQUIRE(set->size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    const double x = set->position[3 * i];
    CHECK(set->sh[12 * i + 3] == Approx(x == 1 ? -4 : x == 3 ? 4 : -2.4));
    CHECK(set->sh[12 * i + 11] == Approx(x == 1 ? -4 : x == 3 ? 4 : -2.4));
  }
}

TEST_CASE("4dgs: the frame rate follows from the settings or the states") {
  Clip clip;
  clip.add_keyframe({solid(1, 0)});
  FourdgsSettings settings;
  settings.frame_time = {1, 10};
  CHECK(read(clip.file.bytes(), nullptr, nullptr, settings)->metadata.frames == 10);
  settings.frame_time = {2, 1};
  clip.add_keyframe({solid(1, 0)});
  ConversionNotes notes;
  CHECK(read(clip.file.bytes(), &notes, nullptr, settings)->metadata.frames == 1);
  CHECK(has_note(notes, "dropped 1 states that lie between frames"));
}

TEST_CASE("4dgs: states that contradict each other are rejected") {
  const auto check = [](const std::string& message, const auto& change) {
    Clip clip;
    clip.add_keyframe({solid(1, 0), solid(2, 4)});
    change(clip);
    INFO(message);
    CHECK_THAT(error_of(clip.file.bytes()), Contains(message));
  };
  const std::vector<int> step = {1, 0, 0};
  check("Gaussian 3 is changed, but does not exist",
        [&](Clip& c) { c.add_delta(moving({solid(3, 0)}, step)); });
  check("Gaussian 2 occurs twice", [&](Clip& c) {
    Delta d;
    d.born = {solid(2, 0)};
    c.add_delta(d);
  });
  check("Gaussian 2 occurs twice", [&](Clip& c) {
    Delta d = moving({solid(2, 0)}, step);
    d.dead = {solid(2, 0)};
    c.add_delta(d);
  });
  check("Gaussian 1 occurs twice", [&](Clip& c) { c.add_keyframe({solid(1, 0), solid(1, 2)}); });
  check("an update changes the sigma, flags or window", [&](Clip& c) {
    Delta d = moving({solid(2, 0)}, step);
    d.update_streams += stream(8, 1, {1});
    c.add_delta(d);
  });
  check("half of a rotation", [&](Clip& c) {
    Delta d = moving({solid(2, 0)}, step);
    d.update_streams += stream(3, 3, {1, 1, 1});
    c.add_delta(d);
  });
  check("exceeds 32 bits", [&](Clip& c) {
    c.add_delta(moving({solid(2, 0)}, {0x7FFFFFFF, 0, 0}));
  });
  check("states end at 1 s of a clip of 3 s", [](Clip& c) { c.file.duration = 3; });
  check("states do not follow each other", [](Clip& c) {
    c.file.duration = 1.5;
    c.add_keyframe({solid(1, 0)});
  });
  const auto with_fields = [](Clip& c, std::uint64_t reference, std::uint64_t keyframe, int depth) {
    Delta d;
    d.begin = 1;
    d.end = c.file.duration = 2;
    d.reference = reference;
    d.keyframe = keyframe;
    d.depth = depth;
    c.file.body += delta_chunk(d);
  };
  check("invalid reference", [&](Clip& c) { with_fields(c, c.last() + 1, c.last(), 1); });
  check("invalid keyframe", [&](Clip& c) { with_fields(c, c.last(), 0, 1); });
  check("invalid depth", [&](Clip& c) { with_fields(c, c.last(), c.last(), 2); });
  Clip headless;
  headless.add_delta({});
  CHECK_THAT(error_of(headless.file.bytes()), Contains("before the first keyframe"));
}

TEST_CASE("4dgs: hostile states neither crash nor run forever") {
  Clip clip;
  clip.add_keyframe({solid(1, 0), solid(2, 4)});
  Delta d = moving({solid(2, 0)}, {1, 0, 0});
  d.born = {solid(3, 1)};
  d.dead = {solid(1, 0)};
  clip.add_delta(d);
  const std::string whole = clip.file.bytes();
  for (std::size_t size = 0; size < whole.size(); ++size) {
    CHECK_FALSE(read(whole.substr(0, size)).ok());
  }
  for (std::size_t at = 0; at < whole.size(); ++at) {
    for (const std::size_t width : {1, 4, 8}) {
      for (const char value : {'\xFF', '\x7F', '\x00'}) {
        std::string bytes = whole;
        for (std::size_t i = at; i < std::min(at + width, bytes.size()); ++i) bytes[i] = value;
        const Result<Scene> scene = read(bytes, nullptr, nullptr, {}, {1000, 1 << 20});
        if (scene.ok()) CHECK(scene->gaussians.size() <= 1000);
      }
    }
  }
  // A long clip of few bytes.
  Clip still;
  still.add_keyframe(std::vector<Gaussian>(1, solid(1, 0)));
  still.file.duration = 1e6;
  CHECK_THAT(error_of(still.file.bytes()), Contains("states end at 1 s"));
}

TEST_CASE("4dgs: a state of many frames is refused if the file has few bytes for their Gaussians") {
  std::vector<Gaussian> set;
  for (int i = 0; i < 1000; ++i) set.push_back(solid(static_cast<std::uint32_t>(i), i));
  File file;
  file.model = "keyframe-delta";
  file.duration = 900;
  file.windows = {{0, 900}};
  file.body = chunk(0, 900, set.size(), streams(set, true));
  FourdgsSettings settings;
  settings.frame_time = TimeBase{1, 100};
  const Result<Scene> scene = read(file.bytes(), nullptr, nullptr, settings);
  CHECK(scene.status().code() == StatusCode::kUnsupported);
  CHECK_THAT(scene.status().message(), Contains("too many Gaussians for a file of"));
  settings.frame_time = TimeBase{1, 1};
  CHECK(read(file.bytes(), nullptr, nullptr, settings).status().message().empty());
}
