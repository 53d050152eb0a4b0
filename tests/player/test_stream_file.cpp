// SPDX-License-Identifier: Apache-2.0
// Playback of a file that changes while it is open.
#include <filesystem>
#include <fstream>

#include "catch.h"
#include "fixtures/temporary_folder.h"
#include "stream/transfer_events.h"
#include "stream_fixture.h"

namespace stgs::player {
namespace {

// The clip as a file, of which the player fetches only what it needs soon.
struct ClipFile {
  ClipFile() { restore(); }
  void restore() const {
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(clip().bytes.data()),
               static_cast<std::streamsize>(clip().bytes.size()));
  }
  void truncate(std::size_t bytes) const { std::filesystem::resize_file(path, bytes); }
  TestPlayer play() const {
    PlayerSettings settings;
    settings.prefetch_seconds = 0.1;
    settings.retry_seconds = 0.01;
    settings.max_reads_in_flight = 1;
    auto opened = Player::open(path, settings);
    REQUIRE(opened.ok());
    return TestPlayer(std::move(*opened));
  }

  testing::TemporaryFolder folder;
  std::string path = folder / "clip.stgs";
};

TEST_CASE("every truncation of a file is reported once, and the restored file plays again") {
  const ClipFile file;
  TestPlayer p = file.play();
  REQUIRE(p.wait_complete());
  int times = 0;
  for (const double time : {1.5, 2.5}) {
    file.truncate(clip().segments_begin + 100);
    REQUIRE(p.player->seek(time).ok());
    ++times;
    REQUIRE(
        p.wait_until([&] { return p.count(Kind::kReplaced) == times && p.player->is_complete(); }));
    CHECK_FALSE(p.player->ready());
    file.restore();
    REQUIRE(p.wait_complete());
    CHECK(active_fingerprints(p.player->timeline(), time) == active_in_file(time));
  }
  CHECK(p.has_event(Kind::kReadFailed, "the file was truncated while open"));
  CHECK(p.has_event(Kind::kReplaced, "the file was overwritten or truncated"));
  CHECK(p.count(Kind::kReplaced) == times);
}

TEST_CASE("a truncated file is reported once while its beginning still plays") {
  const ClipFile file;
  TestPlayer p = file.play();
  REQUIRE(p.wait_complete());
  file.truncate(clip().bytes.size() * 3 / 4);
  for (const double time : {0.3, 2.9, 0.6, 2.6, 0.9, 2.3, 1.2}) {
    REQUIRE(p.player->seek(time).ok());
    REQUIRE(p.wait_until([&] { return p.player->is_complete(); }));
  }
  REQUIRE(p.wait_until([&] { return p.count(Kind::kReplaced) > 0; }));
  CHECK(p.count(Kind::kReplaced) == 1);
}

TEST_CASE("an overwritten file of any size is reported once, and the restored file plays again") {
  const auto& bytes = clip().bytes;
  for (const std::size_t size : {bytes.size(), bytes.size() + 5000, bytes.size() / 2}) {
    CAPTURE(size);
    const ClipFile file;
    TestPlayer p = file.play();
    REQUIRE(p.wait_complete());
    // Only the index, which is in memory already, stays the same.
    std::string other(size, 'x');
    std::copy_n(bytes.begin(), clip().segments_begin, other.begin());
    std::ofstream(file.path, std::ios::binary) << other;
    for (const double time : {1.5, 2.5}) {
      REQUIRE(p.player->seek(time).ok());
      REQUIRE(
          p.wait_until([&] { return p.count(Kind::kReplaced) == 1 && p.player->is_complete(); }));
      CHECK_FALSE(p.player->ready());
    }
    file.restore();
    for (const double time : {2.5, 1.5}) {
      REQUIRE(p.player->seek(time).ok());
      REQUIRE(p.wait_complete());
      CHECK(active_fingerprints(p.player->timeline(), time) == active_in_file(time));
    }
    CHECK(p.count(Kind::kReplaced) == 1);
    CHECK(p.count(Kind::kDamaged) == 0);
  }
}

TEST_CASE("a replaced file is reported once while it stays so, and again after it was restored") {
  TransferEvents events;
  const auto reports = [&] { return events.take().size(); };
  events.set_replaced(true, "another", 5, 100);
  CHECK(reports() == 1);
  for (const double now : {110.0, 169.0, 228.0}) events.set_replaced(true, "another", 5, now);
  CHECK(reports() == 0);
  events.set_replaced(true, "another", 5, 289);  // it may have been restored in between
  CHECK(reports() == 1);
  events.set_replaced(false, "", 0, 290);
  events.set_replaced(true, "another", 5, 291);
  CHECK(reports() == 1);
}

}  // namespace
}  // namespace stgs::player
