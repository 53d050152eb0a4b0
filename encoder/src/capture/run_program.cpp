// SPDX-License-Identifier: Apache-2.0
#include "run_program.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
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

struct Descriptor {
  int number = -1;
  Descriptor() = default;
  explicit Descriptor(int n) : number(n) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() { close(); }
  void close() {
    if (number >= 0) ::close(number);
    number = -1;
  }
};

// The child after a fork, where only what a signal handler may call is allowed: becomes the
// program, or writes to `told` why it cannot.
[[noreturn]] void become(char* const* argv, int input, int output, pid_t parent, int told) {
  // When the thread that forked ends, and be it by SIGKILL, the kernel ends the child. A parent
  // that ended before this call is not seen by the kernel, but by its id.
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != parent) ::_exit(127);
  if (::dup2(input, 0) == 0 && ::dup2(output, 1) == 1 && ::dup2(output, 2) == 2) {
    ::execvp(argv[0], argv);
  }
  const int wrong = errno;
  const auto ignored = ::write(told, &wrong, sizeof(wrong));
  (void)ignored;  // nobody is left to be told
  ::_exit(127);
}

// Starts a program that reads nothing, writes to `log_path` and does not outlive the calling
// thread; 0, or the errno that says why not.
int start_program(char* const* argv, const std::string& log_path, pid_t& child) {
  const Descriptor input(::open("/dev/null", O_RDONLY | O_CLOEXEC));
  const Descriptor output(::open(log_path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666));
  if (input.number < 0 || output.number < 0) return errno;
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return errno;
  const Descriptor told(ends[0]);
  Descriptor tell(ends[1]);
  const pid_t parent = ::getpid();
  child = ::fork();
  if (child < 0) return errno;
  if (child == 0) become(argv, input.number, output.number, parent, tell.number);
  // The pipe ends with the exec, or says why there was none.
  tell.close();
  int wrong = 0;
  ssize_t got = 0;
  do {
    got = ::read(told.number, &wrong, sizeof(wrong));
  } while (got < 0 && errno == EINTR);
  if (got == 0) return 0;
  ::waitpid(child, nullptr, 0);
  return got == sizeof(wrong) ? wrong : EIO;
}

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
  pid_t child = 0;
  const int wrong = start_program(argv.data(), log_path, child);
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
