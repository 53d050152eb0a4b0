// SPDX-License-Identifier: Apache-2.0
// The log of a training is opened once.
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "catch.h"
#include "fixtures/temporary_folder.h"
#include "stgs/encoder/training_log.h"
#include "train/log_writer.h"

namespace stgs::encoder {
namespace {

std::string text_of(const std::string& path) {
  std::ostringstream out;
  out << std::ifstream(path).rdbuf();
  return out.str();
}

TEST_CASE("lines go to the opened log, whatever its name leads to") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "log.jsonl", other = folder / "other";
  std::ofstream(other) << "keep";
  LogWriter log;
  REQUIRE(log.open(path, 0).ok());
  log.write(LoggedStep{.iteration = 1});
  std::filesystem::rename(path, folder / "moved.jsonl");
  std::filesystem::create_symlink(other, path);
  log.write(LoggedStep{.iteration = 2});
  CHECK(log.check().ok());
  CHECK(text_of(other) == "keep");
  const Result<TrainingLog> read = read_training_log(folder / "moved.jsonl");
  REQUIRE(read.ok());
  CHECK(read->steps.size() == 2);
}

TEST_CASE("a resumed log retains its lines, and a truncated one is continued at its end") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "log.jsonl";
  {
    LogWriter log;
    REQUIRE(log.open(path, 0).ok());
    for (const std::uint64_t iteration : {1, 50, 100})
      log.write(LoggedStep{.iteration = iteration});
  }
  LogWriter log;
  REQUIRE(log.open(path, 50).ok());
  CHECK(read_training_log(path)->steps.size() == 2);
  std::filesystem::resize_file(path, 0);
  log.write(LoggedStep{.iteration = 51});
  CHECK(read_training_log(path)->steps.size() == 1);
}

TEST_CASE("a log is written to a pipe through one descriptor") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "pipe";
  REQUIRE(::mkfifo(path.c_str(), 0600) == 0);
  std::string text;
  std::thread reader([&] { text = text_of(path); });
  {
    LogWriter log;
    REQUIRE(log.open(path, 70).ok());  // of a resumed run: there are no lines to retain
    log.write(LoggedStep{.iteration = 1});
    log.write(LoggedEvaluation{.iteration = 1, .seconds = 0, .score = {}});
    CHECK(log.check().ok());
  }
  reader.join();  // it has seen one writer
  CHECK(std::count(text.begin(), text.end(), '\n') == 2);
  CHECK(std::filesystem::is_fifo(path));
}

}  // namespace
}  // namespace stgs::encoder
