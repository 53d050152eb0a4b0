// SPDX-License-Identifier: Apache-2.0
#include "run_program.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <fstream>
#include <regex>
#include <thread>

namespace stgs::encoder {
namespace {

constexpr int kMaxLinesShown = 8;
constexpr rlim_t kMaxWritten = rlim_t{64} << 30;  // bytes of a file that the program writes
constexpr std::streamoff kMaxLog = 1 << 20;       // bytes read from the end of the log
constexpr std::size_t kMaxLine = 1000;            // characters of a line of the log

// An owned file descriptor.
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

// Runs in the child after fork, so only async-signal-safe functions are allowed. Executes the
// program, or writes errno to `error_pipe`.
[[noreturn]] void exec_child(char* const* argv, int input, int output, pid_t parent,
                             int error_pipe) {
  // The kernel kills the child when the forking thread ends, even by SIGKILL. The check of the
  // parent's id covers a parent that ended before this call.
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  // A group of its own, so that its children are killed with it. A terminal's signals do not reach
  // the group; the caller cancels.
  ::setpgid(0, 0);
  const rlimit files{kMaxWritten, kMaxWritten}, cores{0, 0};
  ::setrlimit(RLIMIT_FSIZE, &files);
  ::setrlimit(RLIMIT_CORE, &cores);
  if (::getppid() != parent) ::_exit(127);
  if (::dup2(input, 0) == 0 && ::dup2(output, 1) == 1 && ::dup2(output, 2) == 2) {
    ::execvp(argv[0], argv);
  }
  const int error = errno;
  const auto ignored = ::write(error_pipe, &error, sizeof(error));
  (void)ignored;  // the error cannot be reported elsewhere
  ::_exit(127);
}

// Starts a program with no input and with its output in `log_path`. It does not outlive the calling
// thread. Returns 0 or an errno.
int start_program(char* const* argv, const std::string& log_path, pid_t& child) {
  const Descriptor input(::open("/dev/null", O_RDONLY | O_CLOEXEC));
  const Descriptor output(
      ::open(log_path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0666));
  if (input.number < 0 || output.number < 0) return errno;
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return errno;
  const Descriptor error_source(ends[0]);
  Descriptor error_sink(ends[1]);
  const pid_t parent = ::getpid();
  child = ::fork();
  if (child < 0) return errno;
  if (child == 0) exec_child(argv, input.number, output.number, parent, error_sink.number);
  ::setpgid(child, child);  // also here: it may be killed before it runs
  // A successful exec closes the pipe without data.
  error_sink.close();
  int error = 0;
  ssize_t got = 0;
  do {
    got = ::read(error_source.number, &error, sizeof(error));
  } while (got < 0 && errno == EINTR);
  if (got == 0) return 0;
  ::waitpid(child, nullptr, 0);
  return got == sizeof(error) ? error : EIO;
}

// Returns false once the child has ended. It stays a zombie.
bool is_running(pid_t child) {
  siginfo_t info{};
  return ::waitid(P_PID, static_cast<id_t>(child), &info, WEXITED | WNOHANG | WNOWAIT) == 0 &&
         info.si_pid == 0;
}

}  // namespace

std::string failure_reason(const std::string& log_path) {
  // glog writes "F20240102 03:04:05.678901 1234 file.cc:56] message" for a fatal error (E for an
  // error), then a stack trace. COLMAP's own error lines start with ERROR.
  static const std::regex error_line(R"(^(?:[EF]\d{4,8} .*?\] |\s*ERROR: )(.*)$)");
  std::ifstream file(log_path, std::ios::binary | std::ios::ate);
  file.seekg(std::max(std::streamoff{0}, std::streamoff{file.tellg()} - kMaxLog));
  std::vector<std::string> lines;
  std::string error;
  for (std::string line; std::getline(file, line);) {
    line.resize(std::min(line.size(), kMaxLine));  // std::regex recurses for every character
    while (!line.empty() && std::isspace(static_cast<unsigned char>(line.back()))) line.pop_back();
    if (line.empty()) continue;
    std::smatch match;
    if (std::regex_match(line, match, error_line)) error = match[1];
    lines.push_back(line);
    if (lines.size() > kMaxLinesShown) lines.erase(lines.begin());
  }
  if (!error.empty()) return ": " + error;
  if (lines.empty()) return " without output";
  std::string text;
  for (const std::string& line : lines) text += (text.empty() ? "" : " | ") + line;
  return "; its last lines were: " + text;
}

Status run_program(const std::vector<std::string>& arguments, const std::string& log_path,
                   const std::string& stage, double done, const ProgressSink& progress,
                   std::chrono::steady_clock::time_point deadline, int* exit_code) {
  if (exit_code != nullptr) *exit_code = -1;
  std::vector<char*> argv;
  argv.reserve(arguments.size() + 1);
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  pid_t child = 0;
  const int error = start_program(argv.data(), log_path, child);
  if (error == ENOENT) {
    return not_built("{}: not installed, but needed for this capture (apt-get install {})",
                     arguments[0], arguments[0]);
  }
  if (error != 0) return runtime_error("{}: cannot run: {}", arguments[0], system_message(error));
  const std::string detail = arguments[0] + (arguments.size() > 1 ? " " + arguments[1] : "");
  bool cancelled = false, late = false;
  while (is_running(child)) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    if (cancelled || late) continue;
    late = std::chrono::steady_clock::now() > deadline;
    cancelled = progress && !progress({stage, done, -1, detail});
    if (late || cancelled) ::kill(-child, SIGKILL);  // the caller deletes its partial output
  }
  ::kill(-child, SIGKILL);  // children that it left behind; its id is taken until waitpid()
  int result = 0;
  while (::waitpid(child, &result, 0) < 0 && errno == EINTR) {
  }
  if (cancelled) return runtime_error("{}: cancelled", stage);
  if (late) return runtime_error("{}: stopped by its time limit", detail);
  if (exit_code != nullptr && WIFEXITED(result)) *exit_code = WEXITSTATUS(result);
  if (WIFEXITED(result) && WEXITSTATUS(result) == 0) return {};
  return runtime_error("{}: failed ({} {}){}", detail, WIFEXITED(result) ? "exit code" : "signal",
                       WIFEXITED(result) ? WEXITSTATUS(result) : WTERMSIG(result),
                       failure_reason(log_path));
}

}  // namespace stgs::encoder
