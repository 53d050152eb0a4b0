// SPDX-License-Identifier: Apache-2.0
// Playing a file that changes meanwhile.
#include <filesystem>
#include <fstream>

#include "catch.h"
#include "fixtures/temporary_folder.h"
#include "stream/transfer_events.h"
#include "stream_fixture.h"

namespace stgs::player {
namespace {

// The clip as a file, which is fetched piece after piece as it is needed.
struct ClipFile {
  ClipFile() { make_whole(); }
  void make_whole() const {
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(clip().bytes.data()),
               static_cast<std::streamsize>(clip().bytes.size()));
  }
  void cut(std::size_t bytes) const { std::filesystem::resize_file(path, bytes); }
  Playing play() const {
    PlayerSettings settings;
    settings.prefetch_seconds = 0.1;
    settings.retry_seconds = 0.01;
    settings.max_reads_in_flight = 1;
    auto opened = Player::open(path, settings);
    REQUIRE(opened.ok());
    return Playing(std::move(*opened));
  }

  testing::TemporaryFolder folder;
  std::string path = folder / "clip.stgs";
};

TEST_CASE("a file that is cut while it plays is told as often as it is, and made up for") {
  const ClipFile file;
  Playing p = file.play();
  REQUIRE(p.complete());
  int times = 0;
  for (const double moment : {1.5, 2.5}) {
    file.cut(clip().pieces_at + 100);
    REQUIRE(p.player->seek(moment).ok());
    ++times;
    REQUIRE(p.until([&] { return p.count(Kind::kReplaced) == times && p.player->is_complete(); }));
    CHECK_FALSE(p.player->ready());
    file.make_whole();
    REQUIRE(p.complete());
    CHECK(active_fingerprints(p.player->timeline(), moment) == alive_in_file(moment));
  }
  CHECK(p.said(Kind::kReadFailed, "the file was truncated while open"));
  CHECK(p.said(Kind::kReplaced, "the file was overwritten or truncated"));
  CHECK(p.count(Kind::kReplaced) == times);
}

TEST_CASE("a file that has lost its end is told once, though what is before it still comes") {
  const ClipFile file;
  Playing p = file.play();
  REQUIRE(p.complete());
  file.cut(clip().bytes.size() * 3 / 4);
  for (const double moment : {0.3, 2.9, 0.6, 2.6, 0.9, 2.3, 1.2}) {
    REQUIRE(p.player->seek(moment).ok());
    REQUIRE(p.until([&] { return p.player->is_complete(); }));
  }
  REQUIRE(p.until([&] { return p.count(Kind::kReplaced) > 0; }));
  CHECK(p.count(Kind::kReplaced) == 1);
}

TEST_CASE("a file that is overwritten by another, of any size, is told once, and made up for") {
  const auto& bytes = clip().bytes;
  for (const std::size_t size : {bytes.size(), bytes.size() + 5000, bytes.size() / 2}) {
    CAPTURE(size);
    const ClipFile file;
    Playing p = file.play();
    REQUIRE(p.complete());
    // Its index, which is known already, and nothing else of it.
    std::string other(size, 'x');
    std::copy_n(bytes.begin(), clip().pieces_at, other.begin());
    std::ofstream(file.path, std::ios::binary) << other;
    for (const double moment : {1.5, 2.5}) {
      REQUIRE(p.player->seek(moment).ok());
      REQUIRE(p.until([&] { return p.count(Kind::kReplaced) == 1 && p.player->is_complete(); }));
      CHECK_FALSE(p.player->ready());
    }
    file.make_whole();
    for (const double moment : {2.5, 1.5}) {
      REQUIRE(p.player->seek(moment).ok());
      REQUIRE(p.complete());
      CHECK(active_fingerprints(p.player->timeline(), moment) == alive_in_file(moment));
    }
    CHECK(p.count(Kind::kReplaced) == 1);
    CHECK(p.count(Kind::kDamaged) == 0);
  }
}

TEST_CASE("that a file is another is told once as long as it is, and again when it is again") {
  TransferEvents events;
  const auto told = [&] { return events.take().size(); };
  events.set_replaced(true, "another", 5, 100);
  CHECK(told() == 1);
  for (const double now : {110.0, 169.0, 228.0}) events.set_replaced(true, "another", 5, now);
  CHECK(told() == 0);
  events.set_replaced(true, "another", 5, 289);  // put back meanwhile, for all that is known
  CHECK(told() == 1);
  events.set_replaced(false, "", 0, 290);
  events.set_replaced(true, "another", 5, 291);
  CHECK(told() == 1);
}

}  // namespace
}  // namespace stgs::player
