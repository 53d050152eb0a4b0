// SPDX-License-Identifier: Apache-2.0
// Temporary files and folders, what killed processes leave of them, and locks of outputs.
#include <signal.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <thread>

#include "catch.h"
#include "fixtures/temporary_folder.h"
#include "stgs/format/output_file.h"
#include "stgs/format/output_path.h"
#include "stgs/format/temporary.h"

namespace stgs {
namespace {

namespace fs = std::filesystem;
using testing::TemporaryFolder;
using Names = std::vector<std::string>;

Names names_in(const std::string& folder) {
  Names names;
  for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

void write_text(const std::string& path, const std::string& text) {
  fs::create_directories(fs::path(path).parent_path());
  std::ofstream(path) << text;
}

// A process that has a temporary file and a work folder of `output` until it is killed.
class Holder {
 public:
  explicit Holder(const std::string& output) {
    int ends[2];
    REQUIRE(::pipe(ends) == 0);
    child_ = ::fork();
    REQUIRE(child_ >= 0);
    if (child_ == 0) hold(output, ends[1]);
    ::close(ends[1]);
    char ready = 0;
    REQUIRE(::read(ends[0], &ready, 1) == 1);
    ::close(ends[0]);
  }
  void kill() {
    if (child_ > 0) ::kill(child_, SIGKILL);
    if (child_ > 0) ::waitpid(child_, nullptr, 0);
    child_ = 0;
  }
  ~Holder() { kill(); }

 private:
  [[noreturn]] static void hold(const std::string& output, int ready) {
    TemporaryFile file;
    WorkFolder folder;
    const bool made = file.create(output).ok() && folder.create(output).ok();
    write_text(folder.path() + "/frames/cam00/000000.png", "half an image");
    if (made) (void)!::write(ready, "x", 1);
    for (;;) ::pause();
  }

  pid_t child_ = 0;
};

TEST_CASE("writers of one output in one process do not disturb each other") {
  const TemporaryFolder folder;
  const std::string output = folder / "scene.stgs";
  std::atomic<int> failed{0};
  std::vector<std::thread> writers;
  for (int writer = 0; writer < 4; ++writer) {
    writers.emplace_back([&, writer] {
      const std::vector<std::uint8_t> bytes(100000, static_cast<std::uint8_t>('a' + writer));
      for (int k = 0; k < 20; ++k) {
        OutputFile file;
        if (!check_can_write(output).ok() || !file.open(output).ok()) ++failed;
        remove_leftovers(output);
        for (int part = 0; part < 10; ++part) {
          if (!file.write(std::span(bytes).subspan(0, 10000)).ok()) ++failed;
        }
        if (!file.commit().ok()) ++failed;
      }
    });
  }
  for (std::thread& writer : writers) writer.join();
  CHECK(failed == 0);
  CHECK(names_in(folder.path) == Names{"scene.stgs"});
  std::ifstream file(output, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  REQUIRE(text.size() == 100000);
  CHECK(text == std::string(100000, text[0]));  // of one writer
}

TEST_CASE("checking an output leaves the temporary file of another object") {
  const TemporaryFolder folder;
  const std::string output = folder / "scene.stgs";
  const std::vector<std::uint8_t> bytes{1, 2, 3};
  OutputFile file;
  REQUIRE(file.open(output).ok());
  REQUIRE(file.write(bytes).ok());
  CHECK(check_can_write(output).ok());
  CHECK(remove_leftovers(output).empty());
  CHECK(file.commit().ok());
  CHECK(fs::file_size(output) == 3);
}

TEST_CASE("an uncommitted file is removed") {
  const TemporaryFolder folder;
  {
    OutputFile file;
    REQUIRE(file.open(folder / "scene.stgs").ok());
    CHECK(names_in(folder.path).size() == 1);
  }
  CHECK(names_in(folder.path).empty());
}

TEST_CASE("leftovers of a killed process are removed, files of a running one stay") {
  const TemporaryFolder folder;
  const std::string output = folder / "scene.stgs";
  Holder running(output), killed(output);
  CHECK(remove_leftovers(output).empty());
  CHECK(names_in(folder.path).size() == 4);
  killed.kill();
  write_text(folder / ".scene.999999999.tmp.stgs", "not a name of ours");
  CHECK(remove_leftovers(folder / "other.stgs").empty());
  const Names removed = remove_leftovers(output);
  REQUIRE(removed.size() == 2);
  CHECK(names_in(folder.path).size() == 3);
  running.kill();
  CHECK(remove_leftovers(output).size() == 2);
  CHECK(names_in(folder.path) == Names{".scene.999999999.tmp.stgs"});
}

TEST_CASE("a work folder is private, and is removed without following links") {
  const TemporaryFolder folder;
  write_text(folder / "outside/kept.txt", "kept");
  std::string path;
  {
    WorkFolder work;
    REQUIRE(work.create(folder / "out").ok());
    path = work.path();
    CHECK((fs::status(path).permissions() & fs::perms::all) == fs::perms::owner_all);
    write_text(path + "/a/b/c/file", "text");
    fs::create_directory_symlink(folder / "outside", path + "/a/link");
    fs::create_symlink(folder / "outside/kept.txt", path + "/file");
  }
  CHECK_FALSE(fs::exists(path));
  CHECK(names_in(folder.path) == Names{"outside"});
  CHECK(fs::exists(folder / "outside/kept.txt"));
}

TEST_CASE("a folder that someone renamed to the name of a work folder stays") {
  const TemporaryFolder folder;
  const std::string name = folder / ".scene.stgs.abcdefghijkl.tmp.work";
  for (const std::string own : {"photo.png", "lock"}) {  // without a lock, and with another file
    write_text(name + "/" + own, "kept");
    CHECK(remove_leftovers(folder / "scene.stgs").empty());
    CHECK(names_in(name) == Names{own});
    fs::remove_all(name);
  }
  fs::create_directory(name);  // as a process leaves it that is killed before it makes the lock
  CHECK(remove_leftovers(folder / "scene.stgs").size() == 1);
}

TEST_CASE("a link in place of a leftover is not followed") {
  const TemporaryFolder folder;
  write_text(folder / "outside/kept.txt", "kept");
  fs::create_symlink(folder / "outside/kept.txt", folder / ".scene.abcdefghijkl.tmp.stgs");
  fs::create_directory_symlink(folder / "outside", folder / ".scene.stgs.abcdefghijkl.tmp.work");
  CHECK(remove_leftovers(folder / "scene.stgs").empty());
  CHECK(names_in(folder / "outside") == Names{"kept.txt"});
}

TEST_CASE("temporaries are created while others remove leftovers") {
  const TemporaryFolder folder;
  const std::string output = folder / "scene.stgs";
  std::atomic<bool> done{false};
  std::atomic<int> removed{0};
  std::vector<std::thread> removers;
  for (int k = 0; k < 2; ++k) {
    removers.emplace_back([&] {
      while (!done) removed += static_cast<int>(remove_leftovers(output).size());
    });
  }
  int failed = 0;
  for (int k = 0; k < 300; ++k) {
    TemporaryFile file;
    WorkFolder work;
    if (!file.create(output).ok() || !work.create(output).ok()) ++failed;
    write_text(work.path() + "/made", "text");
    if (!file.commit().ok() || !fs::exists(work.path() + "/made")) ++failed;
  }
  done = true;
  for (std::thread& remover : removers) remover.join();
  CHECK(failed == 0);
  remove_leftovers(output);  // created and removed at the same time
  CHECK(names_in(folder.path) == Names{"scene.stgs"});
}

TEST_CASE("an output has one owner") {
  const TemporaryFolder folder;
  {
    OutputLock first, second, other;
    REQUIRE(first.take(folder / "out").ok());
    const Status status = second.take(folder / "out");
    CHECK(status.code() == StatusCode::kUsage);
    CHECK(status.message().find("another process is writing it") != std::string::npos);
    CHECK_FALSE(second.take(folder / "out/").ok());
    CHECK(other.take(folder / "other").ok());
  }
  OutputLock again;
  CHECK(again.take(folder / "out").ok());
  CHECK(names_in(folder.path) == Names{".out.lock"});
}

TEST_CASE("a file in the place of a lock that is not one stays") {
  const TemporaryFolder folder;
  const std::string name = folder / ".out.lock";
  const auto refused = [&] {
    OutputLock lock;
    const Status status = lock.take(folder / "out");
    CHECK(status.code() == StatusCode::kUsage);
    CHECK_THAT(status.message(), Catch::Contains("/.out.lock is not a lock"));
  };
  write_text(name, "important");
  refused();
  CHECK(fs::file_size(name) == 9);
  fs::remove(name);
  REQUIRE(::mkfifo(name.c_str(), 0600) == 0);
  refused();
  CHECK(fs::is_fifo(name));
}

TEST_CASE("an output has the permissions of the file that it replaces") {
  const TemporaryFolder folder;
  const auto mode_of = [](const std::string& path) {
    struct stat status {};
    REQUIRE(::stat(path.c_str(), &status) == 0);
    return status.st_mode & 07777;
  };
  const auto mode_after = [&](const std::string& name, mode_t before) {
    const std::string path = folder / name;
    write_text(path, "old");
    REQUIRE(::chmod(path.c_str(), before) == 0);
    OutputFile file;
    REQUIRE(file.open(path).ok());
    REQUIRE(file.write(std::vector<std::uint8_t>{'n'}).ok());
    REQUIRE(file.commit().ok());
    CHECK(fs::file_size(path) == 1);
    CHECK(mode_of(path) == (before & 0777));
    write_text(folder / "made", "text");
    REQUIRE(::chmod(path.c_str(), before) == 0);
    REQUIRE(rename_over(folder / "made", path).ok());
    return mode_of(path);
  };
  CHECK(mode_after("private", 0600) == 0600);
  CHECK(mode_after("shared", 0664) == 0664);
  CHECK(mode_after("program", 04755) == 0755);  // not the identity of the owner
}

TEST_CASE("a socket is refused as an output, a pipe is written") {
  const TemporaryFolder folder;
  const std::string path = folder / "socket";
  const int socket = ::socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  REQUIRE(path.size() < sizeof address.sun_path);
  std::memcpy(address.sun_path, path.c_str(), path.size());
  REQUIRE(::bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
  OutputFile refused, file;
  CHECK(refused.open(path).code() == StatusCode::kIo);
  ::close(socket);
  REQUIRE(::mkfifo((folder / "pipe").c_str(), 0600) == 0);
  std::thread reader([&] { std::ifstream(folder / "pipe").get(); });
  CHECK(file.open(folder / "pipe").ok());
  CHECK(file.write(std::vector<std::uint8_t>{1}).ok());
  CHECK(file.commit().ok());
  reader.join();
  CHECK(names_in(folder.path) == Names{"pipe", "socket"});
}

TEST_CASE("a published file stays open, and is appended to whatever its name leads to") {
  const TemporaryFolder folder;
  const std::vector<std::uint8_t> byte = {'x'};
  OutputFile file;
  REQUIRE(file.open(folder / "log").ok());
  CHECK(file.write(byte).ok());
  CHECK_FALSE(fs::exists(folder / "log"));
  REQUIRE(file.publish().ok());
  CHECK(names_in(folder.path) == Names{"log"});
  write_text(folder / "other", "other");
  fs::rename(folder / "log", folder / "moved");
  fs::create_symlink(folder / "other", folder / "log");
  CHECK(file.write(byte).ok());
  CHECK(fs::file_size(folder / "moved") == 2);
  CHECK(fs::file_size(folder / "other") == 5);
  fs::resize_file(folder / "moved", 0);
  CHECK(file.write(byte).ok());
  CHECK(fs::file_size(folder / "moved") == 1);
}

// Makes and removes temporaries of `output` in a thread, and ends in the middle of it.
[[noreturn]] void end_at_work(const std::string& output, std::chrono::microseconds after) {
  std::atomic<int> round = 0;
  std::thread([&output, &round] {
    for (;; ++round) {
      OutputLock lock;
      WorkFolder work;
      TemporaryFile file;
      if (!lock.take(output).ok() || !work.create(output).ok() || !file.create(output).ok()) break;
      ::mkdir((work.path() + "/c").c_str(), 0700);
      for (const char* name : {"a", "b", "c/d", "c/e"}) {
        std::ofstream(work.path() + "/" + name) << name;
      }
      if (round % 2 != 0 && !file.commit().ok()) break;
    }
  }).detach();
  while (round == 0) std::this_thread::yield();
  std::this_thread::sleep_for(after);
  remove_unfinished();
  std::_Exit(0);
}

TEST_CASE("a process that ends in the middle of work leaves no temporaries") {
  const TemporaryFolder folder;
  constexpr int kProcesses = 100;
  for (int k = 0; k < kProcesses; ++k) {
    const pid_t child = ::fork();
    REQUIRE(child >= 0);
    if (child == 0) end_at_work(folder / "out", std::chrono::microseconds(1000 + 37 * k));
    int status = -1;
    REQUIRE(::waitpid(child, &status, 0) == child);
    CHECK(status == 0);
    fs::remove(folder / "out");
    REQUIRE(names_in(folder.path).empty());
  }
}

}  // namespace
}  // namespace stgs
