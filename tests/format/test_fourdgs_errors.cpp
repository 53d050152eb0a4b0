// SPDX-License-Identifier: Apache-2.0
#include "fourdgs_reading.h"

using namespace stgs;
using namespace stgs::testing::fourdgs;
using Catch::Contains;

TEST_CASE("4dgs: files that must be refused name the reason") {
  const std::vector<Gaussian> set = {fading()};
  const File file = birth_file(set);
  const auto unsupported = StatusCode::kUnsupported;
  std::string bytes = file.bytes();
  bytes[5] = '2';
  CHECK_THAT(error_of(bytes, unsupported), Contains("unsupported version of .4dgs"));
  bytes[0] = 'x';
  CHECK_THAT(error_of(bytes), Contains("not a .4dgs file"));

  File changed = file;
  changed.model = "deformation-field";
  CHECK_THAT(error_of(changed.bytes(), unsupported),
             Contains("unsupported temporal model") && Contains("\"deformation-field\""));
  changed = file;
  changed.scheme = "uniform-v2";
  CHECK_THAT(error_of(changed.bytes(), unsupported), Contains("unsupported quantisation"));
  changed = file;
  changed.windows.clear();  // counts as one window from 0 to 0: nothing is visible
  CHECK(read_valid(changed.bytes()).gaussians.size() == 0);
  for (const double cutoff : {0.0, -1.0, 1.5, std::nan("")}) {
    changed = file;
    changed.cutoff = cutoff;
    CHECK_THAT(error_of(changed.bytes()), Contains("invalid cut-off"));
  }
  changed = file;
  changed.steps[3] = INFINITY;
  CHECK_THAT(error_of(changed.bytes()), Contains("a quantisation step is not finite"));
  changed = file;
  changed.gaussians = 2;
  CHECK_THAT(error_of(changed.bytes()), Contains("Gaussians are missing (expected 2, got 1"));
  changed = file;
  changed.duration = 1e300;
  CHECK_THAT(error_of(changed.bytes(), unsupported), Contains("too many frames"));
  changed = file;
  changed.extra = record(4, Fields().u32(0).text);
  CHECK_THAT(error_of(changed.bytes()), Contains("a second window table"));

  Gaussian g = fading();
  g.window = 1;
  CHECK_THAT(error_of(birth_file({g}).bytes()), Contains("window 1 is not in the table of 1"));
  g = fading();
  g.rotation_index = 4;
  CHECK_THAT(error_of(birth_file({g}).bytes()), Contains("invalid rotation index"));
  const auto with_streams = [&](const std::string& text, const std::string& codec = "") {
    File out = file;
    out.body = chunk(0, 2, 1, text, codec);
    return out.bytes();
  };
  CHECK_THAT(error_of(with_streams(streams(set) + stream(5, 1, {1}))), Contains("two streams 5"));
  CHECK_THAT(error_of(with_streams(stream(0, 3, {1, 2, 3}))), Contains("lacks stream 1"));
  CHECK_THAT(error_of(with_streams(stream(0, 2, {1, 2}))), Contains("wrong size of stream 0"));
  CHECK_THAT(error_of(with_streams(streams(set) + stream(13, 1, {1}))), Contains("identities"));
  CHECK_THAT(error_of(with_streams(streams(set), "lzma"), unsupported), Contains("\"lzma\""));
  std::string other_coder = streams(set);
  other_coder[3] = 9;
  CHECK_THAT(error_of(with_streams(other_coder), unsupported), Contains("unknown coder 9"));
  std::string bad_sum = stream(0, 3, {1, 2, 3});
  bad_sum.back() = static_cast<char>(bad_sum.back() ^ 1);
  CHECK_THAT(error_of(with_streams(bad_sum + streams(set).substr(bad_sum.size()))),
             Contains("zlib stream is damaged"));

  File tracked = file;
  tracked.body = chunk(0, 2, 1, streams(set) + stream(14, 1, {7}));
  Fields track;
  track.u32(7).u8(0).u32(1).f64(0).f64(0).f64(0).f64(0).f64(1).f64(0.5).f64(0).f64(0);
  tracked.extra = record(0x25, track.text);
  CHECK_THAT(error_of(tracked.bytes(), unsupported), Contains("object 7 moves along a track"));
  FourdgsSettings settings;
  settings.tolerances.emplace();
  CHECK(read(file.bytes(), nullptr, nullptr, settings).status().code() == StatusCode::kUsage);
}

TEST_CASE("4dgs: hostile files neither crash nor allocate more than their bytes justify") {
  std::vector<Gaussian> set = {fading(), fading()};
  for (Gaussian& g : set) g.sh.assign(9, 100);
  File file = birth_file(set);
  file.sh_degree = 1;
  file.body += bands(set, 1);
  const std::string whole =
      file.bytes(index_entry(0, 2, file.head().size(), chunk(0, 2, 2, streams(set)).size(), 2));
  REQUIRE(read(whole).ok());
  for (std::size_t size = 0; size < whole.size(); ++size) {
    CHECK_FALSE(read(whole.substr(0, size)).ok());
  }
  const ReadLimits limits{1000, 1 << 20};
  for (std::size_t at = 0; at < whole.size(); ++at) {
    for (const std::size_t width : {1, 2, 4, 8}) {
      for (const char value : {'\xFF', '\x7F', '\x00'}) {
        std::string bytes = whole;
        for (std::size_t i = at; i < std::min(at + width, bytes.size()); ++i) bytes[i] = value;
        const Result<Scene> scene = read(bytes, nullptr, nullptr, {}, limits);
        if (scene.ok()) CHECK(scene->gaussians.size() <= 2);
      }
    }
  }
  // A few bytes that claim to be a billion Gaussians.
  File bomb = birth_file({fading()}, {kConstant, 1, kDeflate});
  for (std::uint32_t count : {1u << 30, 0xFFFFFFFFu}) {
    bomb.gaussians = count;
    std::string text = streams({fading()}, false, {kConstant, 1, kDeflate});
    bomb.body = chunk(0, 2, count, text);
    CHECK_THAT(error_of(bomb.bytes(), StatusCode::kUnsupported), Contains("too many primitives"));
    CHECK_THAT(read(bomb.bytes(), nullptr, nullptr, {}, {~0ull, ~0ull}).status().message(),
               Contains("do not fit in"));
  }
  // A chunk that claims to expand beyond the coder's greatest ratio.
  File inflated = birth_file({fading()});
  const std::string stored = stored_zlib("abc");
  Fields content;
  content.f64(0).f64(2).u32(0).u32(1).string("deflate").u64(1ull << 32).blob(stored);
  inflated.body = record(5, content.text);
  CHECK_THAT(error_of(inflated.bytes()), Contains("do not fit in 14 compressed bytes"));
}
