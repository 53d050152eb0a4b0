// SPDX-License-Identifier: Apache-2.0
#include "run_program.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <fstream>
#include <regex>
#include <thread>

namespace stgs::encoder {
namespace {

constexpr int kLinesShown = 8;

}  // namespace

std::string failure_reason(const std::string& log_path) {
  // "F20240102 03:04:05.678901 1234 file.cc:56] what" is a fatal line of glog, E an error; a trace
  // of the stack follows it. COLMAP's own begin with ERROR.
  static const std::regex error_line(R"(^(?:[EF]\d{4,8} .*?\] |\s*ERROR: )(.*)$)");
  std::ifstream file(log_path);
  std::vector<std::string> lines;
  std::string error;
  for (std::string line; std::getline(file, line);) {
    while (!line.empty() && std::isspace(static_cast<unsigned char>(line.back()))) line.pop_back();
    if (line.empty()) continue;
    std::smatch match;
    if (std::regex_match(line, match, error_line)) error = match[1];
    lines.push_back(line);
    if (lines.size() > kLinesShown) lines.erase(lines.begin());
  }
  if (!error.empty()) return ": " + error;
  if (lines.empty()) return ", and wrote nothing";
  std::string text = "; its last lines were:";
  for (const std::string& line : lines) text += "\n  " + line;
  return text;
}

Status run_program(const std::vector<std::string>& arguments, const std::string& log_path,
                   const std::string& stage, double done, const ProgressSink& progress,
                   int* exit_code) {
  if (exit_code != nullptr) *exit_code = -1;
  std::vector<char*> argv;
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 1, log_path.c_str(), O_WRONLY | O_CREAT | O_TRUNC,
                                   0666);
  posix_spawn_file_actions_adddup2(&actions, 1, 2);
  pid_t child = 0;
  const int wrong = posix_spawnp(&child, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (wrong == ENOENT) {
    return not_built("{}: is not installed (apt-get install {}), and is needed here", arguments[0],
                     arguments[0]);
  }
  if (wrong != 0) return runtime_error("{}: cannot run: {}", arguments[0], system_message(wrong));
  const std::string detail = arguments[0] + (arguments.size() > 1 ? " " + arguments[1] : "");
  bool cancelled = false;
  int result = 0;
  while (::waitpid(child, &result, WNOHANG) == 0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    if (cancelled || !progress || progress({stage, done, -1, detail})) continue;
    cancelled = true;
    ::kill(child, SIGKILL);  // what it leaves lies in a folder that goes too
  }
  if (cancelled) return runtime_error("{}: cancelled", stage);
  if (exit_code != nullptr && WIFEXITED(result)) *exit_code = WEXITSTATUS(result);
  if (WIFEXITED(result) && WEXITSTATUS(result) == 0) return {};
  return runtime_error("{}: failed ({} {}){}", detail, WIFEXITED(result) ? "exit code" : "signal",
                       WIFEXITED(result) ? WEXITSTATUS(result) : WTERMSIG(result),
                       failure_reason(log_path));
}

}  // namespace stgs::encoder
