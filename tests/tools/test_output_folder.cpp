// SPDX-License-Identifier: Apache-2.0
// Files that replace those of a folder: all, whatever signals arrive, or those that an error names.
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <fstream>
#include <functional>
#include <thread>

#include "catch.h"
#include "end_after_signal.h"
#include "fixtures/temporary_folder.h"
#include "output_folder.h"

namespace {
// Called before each move with its number, from 1. Returns an errno to fail with, or 0.
std::function<int(int)> before_move;
int moves = 0;
}  // namespace

// Takes the place of the C library's.
extern "C" int renameat(int from, const char* old_name, int to, const char* new_name) {
  const int error = before_move ? before_move(++moves) : 0;
  if (error != 0) {
    errno = error;
    return -1;
  }
  return static_cast<int>(::syscall(SYS_renameat2, from, old_name, to, new_name, 0));
}

namespace stgs::tools {
namespace {

namespace fs = std::filesystem;
using Catch::Contains;

void write_text(const std::string& path, const std::string& text) {
  std::ofstream(path) << text;
}

std::string text_of(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

// A folder with the old files 0 to 4, and new ones to replace them.
struct Replaced {
  testing::TemporaryFolder folder;
  OutputFolder files{folder.path, [](int, const std::string&) {}};

  Replaced() {
    for (int i = 0; i < 5; ++i) {
      write_text(folder / std::to_string(i), "old");
      const auto path = files.add(std::to_string(i));
      REQUIRE(path.ok());
      write_text(*path, "new");
    }
  }
  std::string contents() const {
    std::string all;
    for (int i = 0; i < 5; ++i) all += text_of(folder / std::to_string(i)) + " ";
    return all;
  }
  Status commit(std::function<int(int)> before) {
    moves = 0;
    before_move = std::move(before);
    const Status status = files.commit();
    before_move = {};
    return status;
  }
};

TEST_CASE("signals between the moves of files have no effect") {
  install_signal_handlers();
  Session session;
  const EndAfterSignal end(session, "not written");
  Replaced replaced;
  const Status status = replaced.commit([](int move) {
    if (move != 3) return 0;
    std::raise(SIGTERM);
    std::raise(SIGINT);
    std::this_thread::sleep_for(std::chrono::milliseconds(1500));  // it would end the program
    return 0;
  });
  CHECK(status.message().empty());
  CHECK(replaced.contents() == "new new new new new ");
  CHECK_FALSE(interrupted());
}

TEST_CASE(
    "a move that fails leaves the other files as they were, and the error names the new ones") {
  Replaced replaced;
  const Status status = replaced.commit([](int move) { return move == 4 ? EIO : 0; });
  CHECK(status.code() == StatusCode::kIo);
  CHECK_THAT(status.message(), Contains("/3: cannot replace: "));
  CHECK_THAT(status.message(),
             Contains("; 3 of 5 files are new (0 to 2), the others are as before"));
  CHECK(replaced.contents() == "new new new old old ");

  Replaced none;
  CHECK_THAT(none.commit([](int) { return EIO; }).message(), Contains("no file was replaced"));
  CHECK(none.contents() == "old old old old old ");
}

TEST_CASE("a file of a folder has the permissions of the one that it replaces") {
  Replaced replaced;
  REQUIRE(::chmod((replaced.folder / "1").c_str(), 0600) == 0);
  REQUIRE(replaced.commit({}).ok());
  CHECK((fs::status(replaced.folder / "1").permissions() & fs::perms::all) ==
        (fs::perms::owner_read | fs::perms::owner_write));
}

// The last one: the signal stays.
TEST_CASE("after a signal, nothing is moved") {
  install_signal_handlers();
  Replaced replaced;
  std::raise(SIGTERM);
  CHECK(replaced.commit({}).code() == StatusCode::kRuntime);
  CHECK(replaced.contents() == "old old old old old ");
}

}  // namespace
}  // namespace stgs::tools
