// SPDX-License-Identifier: Apache-2.0
#include "fourdgs_reading.h"

using namespace stgs;
using namespace stgs::testing::fourdgs;
using Catch::Contains;

TEST_CASE("4dgs: the fields of a fade are converted as the format defines them") {
  // The answers are computed by hand from the steps of the fixture.
  const Scene scene = read_valid(birth_file({fading()}).bytes());
  CHECK(scene.metadata.frames == 60);
  CHECK(scene.metadata.time_base == TimeBase{1, 30});
  CHECK(scene.parts.empty());
  const Gaussians4D& set = scene.gaussians;
  REQUIRE(set.size() == 1);
  // Sigma bin 0 is a deviation of 1 s. The step of its time is 0.1 s / 2, which is at most 0.05 s;
  // that of its velocity is 0.4 / 4, because it is visible for more than 1 s on both sides.
  CHECK(set.time[0] == Approx(1.0 * 30));
  CHECK(set.sigma[0] == Approx(std::sqrt(2.0) * 30));
  CHECK(set.radius[0] == 0);
  CHECK(set.position[0] == Approx(1 + 2 * 0.5));
  CHECK(set.position[1] == Approx(2 - 4 * 0.5));
  CHECK(set.position[2] == Approx(3 + 6 * 0.5));
  CHECK(set.velocity[0] == Approx(8 * 0.1 / 30));
  CHECK(set.velocity[2] == Approx(-4 * 0.1 / 30));
  CHECK(set.log_scale[0] == Approx(-1));
  CHECK(set.log_scale[1] == Approx(-2));
  CHECK(set.log_scale[2] == Approx(0.5));
  // x = 0.5, z = 0, w = -0.25; y is positive.
  CHECK(set.rotation[0] == Approx(-0.25));
  CHECK(set.rotation[1] == Approx(0.5));
  CHECK(set.rotation[2] == Approx(std::sqrt(1 - 0.3125)));
  CHECK(set.rotation[3] == Approx(0).margin(1e-12));
  CHECK(0.5 + 0.28209479 * set.sh[0] == Approx(14 * 0.05));
  CHECK(0.5 + 0.28209479 * set.sh[1] == Approx(10 * 0.05));
  CHECK(0.5 + 0.28209479 * set.sh[2] == Approx(0).margin(1e-7));
  CHECK(opacity(set, 0) == Approx(15 * 0.05));
  for (const double seconds : {0.0, 0.5, 1.5}) {
    CHECK(visibility(set, 0, 30 * seconds) ==
          Approx(std::exp(-0.5 * (seconds - 1) * (seconds - 1))));
  }
}

TEST_CASE("4dgs: the steps of velocity and time depend on the lifespan") {
  Gaussian brief = fading();
  brief.sigma = -4;  // a deviation of e^-2 s: 0.135
  Gaussian box = fading();
  box.flags = 1;
  box.window = 1;
  box.time = 4;
  File file = birth_file({brief, box});
  file.windows = {{0, 2}, {0.25, 0.5}};
  const Scene scene = read_valid(file.bytes());
  const Gaussians4D& set = scene.gaussians;
  REQUIRE(set.size() == 2);
  // 0.05 * 0.135 s allows the time 0.1 s / 16, and 2.4477 * 0.135 s the velocity 0.4 / 1.
  CHECK(set.time[0] == Approx(20 * 0.1 / 16 * 30));
  CHECK(set.velocity[0] == Approx(8 * 0.4 / 30));
  // A window of 0.25 s allows the velocity 0.4 * 2. Never fading, the step of time is 0.1 s.
  CHECK(set.velocity[3] == Approx(8 * 0.8 / 30));
  CHECK(coordinate(set, 1, 0, 0.4 * 30) == Approx(2));
  CHECK(coordinate(set, 1, 0, 0.5 * 30) == Approx(2 + 8 * 0.8 * 0.1));
}

TEST_CASE("4dgs: all codings of a stream give the same values") {
  std::vector<Gaussian> set = {fading(), fading(), fading()};
  set[1].position = {300, -300, 7};
  set[2].position = {0, 1, 2};
  const Scene expected = read_valid(birth_file(set).bytes());
  for (const Coding& coding : {Coding{kDelta, 4, kDeflate}, Coding{kRaw, 2, kDeflate},
                               Coding{kDelta, 2, kZstd}, Coding{kRaw, 4, kZstd}}) {
    const Scene scene = read_valid(birth_file(set, coding).bytes());
    CHECK(scene.gaussians.position == expected.gaussians.position);
    CHECK(scene.gaussians.rotation == expected.gaussians.rotation);
  }
  for (const char* codec : {"deflate", "zstd"}) {
    File file = birth_file(set);
    file.body = chunk(0, 2, 3, streams(set), codec);
    CHECK(read_valid(file.bytes()).gaussians.position == expected.gaussians.position);
  }
  const std::vector<Gaussian> same(3, fading());
  const Scene constant = read_valid(birth_file(same, {kConstant, 1, kDeflate}).bytes());
  CHECK(constant.gaussians.position == read_valid(birth_file(same).bytes()).gaussians.position);
}

TEST_CASE("4dgs: unknown records, attributes and appended fields are skipped") {
  const std::vector<Gaussian> set = {fading()};
  File file = birth_file(set);
  const Scene expected = read_valid(file.bytes());
  file.extra = record(0x90, "private") + record(0x7E, "later") + record(0x0D, "an attachment") +
               record(0x11, "audio");
  file.body = chunk(0, 2, 1, streams(set) + stream(70, 2, {1, 2}) + stream(11, 1, {5}));
  ConversionNotes notes;
  const Scene scene = read_valid(file.bytes(), &notes);
  CHECK(scene.gaussians.position == expected.gaussians.position);
  CHECK(has_note(notes, "dropped 1 audio source, 1 attachment, 2 unknown records"));
}

TEST_CASE("4dgs: windows become flat tops, parts or nothing") {
  Gaussian whole, short_box, cut, contained, outside;
  whole.flags = short_box.flags = 1;
  short_box.window = cut.window = 1;
  cut.time = 10;  // fades over 1 s, but is shown from 0.5 s to 1 s
  contained.time = 12;
  contained.sigma = -8;
  outside = whole;
  outside.window = 2;
  File file = birth_file({whole, cut, short_box, contained, outside});
  file.windows = {{0, 2}, {0.5, 1}, {3, 4}};
  ConversionNotes notes;
  const Scene scene = read_valid(file.bytes(), &notes);
  const Gaussians4D& set = scene.gaussians;
  REQUIRE(set.size() == 4);
  CHECK(has_note(notes, "dropped 1 of 5 primitives that are never visible"));
  // Covers the clip: as a static primitive.
  CHECK(set.time[0] == 30);
  CHECK(set.radius[0] == 60);
  CHECK(set.sigma[0] == 1);
  // Visible at the frames of [0.5 s, 1 s) and at no other.
  for (int frame = 0; frame < 60; ++frame) {
    CHECK(visibility(set, 1, frame) ==
          (frame >= 15 && frame < 30 ? Approx(1) : Approx(0).margin(0.003)));
  }
  CHECK(set.sigma[2] == Approx(30 * std::sqrt(2.0) * std::exp(-4.0)));
  // The part with the fade that is cut off.
  REQUIRE(scene.parts.size() == 2);
  CHECK(scene.parts[0] == ScenePart{0, 60, 3});
  CHECK(scene.parts[1] == ScenePart{15, 30, 1});
  CHECK(set.time[3] == Approx(10 * 0.05 * 30 - 15));
  const auto frame_14 = snapshot_at(scene, 14), frame_15 = snapshot_at(scene, 15);
  CHECK(frame_14->size() == 1);
  CHECK(frame_15->size() == 3);
}

TEST_CASE("4dgs: fades that the file cuts off are continued, and the error is reported") {
  Gaussian g = fading();
  g.sigma = -4;
  File file = birth_file({g});
  file.cutoff = 0.25;
  FourdgsReport report;
  ConversionNotes notes;
  REQUIRE(read(file.bytes(), &notes, &report).ok());
  CHECK(report.continued_fades == 1);
  CHECK(report.cut_max == Approx(0.25 * 0.75));
  CHECK(has_note(notes,
                 "1 of 1 primitives fade out where the file cuts their fade off: their "
                 "opacity differs by up to 0.188"));
  file.cutoff = 1.0 / 255;
  REQUIRE(read(file.bytes(), &notes, &report).ok());
  CHECK(report.continued_fades == 0);
}

TEST_CASE("4dgs: SH bands are component-major bytes from -4 to 4") {
  Gaussian a, b;
  for (int k = 0; k < 45; ++k) {
    a.sh.push_back(k);
    b.sh.push_back(255 - k);
  }
  for (int degree = 1; degree <= 3; ++degree) {
    File file = birth_file({a, b});
    file.sh_degree = degree;
    file.body += bands({a, b}, degree);
    const Scene scene = read_valid(file.bytes());
    const Gaussians4D& set = scene.gaussians;
    REQUIRE(set.sh_degree == degree);
    const auto n = static_cast<std::size_t>(set.sh_coefficients());
    for (std::size_t k = 1; k < n; ++k) {
      // Coefficient k is in band l, at k - l^2, after the 3 (l^2 - 1) bytes of the bands before.
      const std::size_t l = k < 4 ? 1 : k < 9 ? 2 : 3;
      for (std::size_t c = 0; c < 3; ++c) {
        const double byte = static_cast<double>(3 * (l * l - 1) + c * (2 * l + 1) + k - l * l);
        CHECK(set.sh[3 * k + c] == Approx(-4 + byte * 8 / 255));
        CHECK(set.sh[3 * (n + k) + c] == Approx(4 - byte * 8 / 255));
      }
    }
    file.body.resize(file.body.size() - 1);
    CHECK_FALSE(read(file.bytes()).ok());
  }
  File file = birth_file({a});
  file.sh_degree = 1;
  CHECK_THAT(error_of(file.bytes()), Contains("a chunk has 0 SH bands in a file of SH degree 1"));
}

TEST_CASE("4dgs: axes, units, title and camera") {
  Fields frame, camera;
  frame.string("").u8(1).u8(1).u8(5).u8(2).f64(0.01);  // right-handed, up y, forward -z
  camera.f64(60).f64(0).f64(1).f64(5).f64(0).f64(1).f64(0).u32(0).string("spline").u8(0);
  File file = birth_file({fading()});
  file.extra = record(0x20, frame.text) + record(0x0A, camera.text);
  file.attributes = {{"title", "a title"}, {"stgs_frame_seconds", "1/25"}};
  const Scene scene = read_valid(file.bytes());
  CHECK(scene.gaussians.position[0] == Approx(2));
  CHECK(scene.gaussians.position[1] == Approx(0).margin(1e-6));
  CHECK(scene.gaussians.position[2] == Approx(-6));
  CHECK(scene.gaussians.velocity[2] == Approx(4 * 0.1 / 25));
  CHECK(scene.metadata.frames == 50);
  CHECK(scene.metadata.title == "a title");
  CHECK(scene.metadata.metres_per_unit == 0.01f);
  // At (0, -1, -5), looking along z with y down.
  REQUIRE(scene.metadata.start_camera);
  const StartCamera& c = *scene.metadata.start_camera;
  CHECK(c.rotation[0] == Approx(1));
  CHECK(c.rotation[4] == Approx(1));
  CHECK(c.rotation[8] == Approx(1));
  CHECK(c.translation[1] == Approx(1));
  CHECK(c.translation[2] == Approx(5));
  CHECK(c.fy == Approx(360 / std::tan(std::acos(-1.0) / 6)));

  File older = birth_file({fading()});
  older.attributes = {{"coordinate_system", "y-up-right-handed"}};
  CHECK(read_valid(older.bytes()).gaussians.position[2] == Approx(-6));
  older.attributes = {{"coordinate_system", "y-up-left-handed"}};
  CHECK(read_valid(older.bytes()).gaussians.position[2] == Approx(6));
  older.attributes = {{"coordinate_system", "z-up-right-handed"}};
  ConversionNotes notes;
  const Scene z_up = read_valid(older.bytes(), &notes);
  CHECK(z_up.metadata.up[2] == 1);
  CHECK(z_up.gaussians.position[2] == Approx(6));
  CHECK(has_note(notes, "up is not along y"));
}

TEST_CASE("4dgs: linear colours become sRGB") {
  File file = birth_file({fading()});
  file.attributes = {{"color_space", "linear-rec709-display"}};
  ConversionNotes notes;
  const Scene scene = read_valid(file.bytes(), &notes);
  CHECK(0.5 + 0.28209479 * scene.gaussians.sh[1] == Approx(0.735357));  // of 0.5
  CHECK(has_note(notes, "linear colours were converted to sRGB"));
  file.attributes = {{"color_space", "p3"}};
  CHECK_THAT(error_of(file.bytes(), StatusCode::kUnsupported), Contains("unknown colour space"));
}

TEST_CASE("4dgs: a wrong checksum of the index is reported, a wrong index rejected") {
  File file = birth_file({fading()});
  const std::uint64_t at = file.head().size();
  const std::string entry = index_entry(0, 2, at, file.body.size(), 1);
  ConversionNotes notes;
  read_valid(file.bytes(entry), &notes);
  CHECK(notes.size() == 1);  // of the continued fade
  notes.clear();
  read_valid(file.bytes(entry, 1), &notes);
  CHECK(has_note(notes, "the checksum of the index is wrong"));
  CHECK_THAT(error_of(file.bytes(index_entry(0, 2, at + 1, file.body.size(), 1))),
             Contains("(no chunk)"));
  CHECK_THAT(error_of(file.bytes(index_entry(0, 1, at, file.body.size(), 1))),
             Contains("(interval)"));
  CHECK_THAT(error_of(file.bytes(index_entry(0, 2, at, file.body.size() - 1, 1))),
             Contains("(length)"));
  CHECK_THAT(error_of(file.bytes(index_entry(0, 2, at, file.body.size(), 2))), Contains("(count)"));
}
