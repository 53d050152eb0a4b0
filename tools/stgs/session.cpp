// SPDX-License-Identifier: Apache-2.0
#include "session.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <system_error>

#include "error_report.h"
#include "output_path.h"
#include "printable.h"
#include "standard_streams.h"
#include "stgs/format/parallel.h"
#include "stgs/format/temporary.h"
#include "stgs/format/thread_pool.h"

namespace stgs::tools {
namespace {

constexpr double kShowInterval = 0.1;  // seconds between two updates of the same stage
constexpr int kBarWidth = 28;
constexpr std::chrono::milliseconds kSignalPoll(50);  // of the watcher thread

std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free, "used in a signal handler");

std::atomic<int> stop_signal{0};
static_assert(std::atomic<int>::is_always_lock_free, "used in a signal handler");

std::atomic<std::time_t> stop_requested_at{0};
static_assert(std::atomic<std::time_t>::is_always_lock_free, "used in a signal handler");

// A second signal ends the program at once, unless it arrives within a second of the first: a
// terminal and `timeout` may both signal this process.
void request_stop(int signal) {
  const std::time_t now = std::time(nullptr);
  if (!stop_requested.exchange(true)) {
    stop_signal = signal;
    stop_requested_at = now;
  } else if (now > stop_requested_at + 1) {
    std::signal(signal, SIG_DFL);
    std::raise(signal);
  }
}

std::string duration_text(double seconds) {
  const auto total = static_cast<long>(seconds + 0.5);
  if (total < 60) return fmt::format("{} s", total);
  if (total < 3600) return fmt::format("{}:{:02} min", total / 60, total % 60);
  return fmt::format("{}:{:02} h", total / 3600, total / 60 % 60);
}

int level_of(const std::string& name) {
  return name == "error" ? 0 : name == "warning" ? 1 : name == "debug" ? 3 : 2;
}

}  // namespace

std::string json_text(const Json& json, int indent) {
  return json.dump(indent, ' ', true, Json::error_handler_t::replace);
}

Status Session::start() {
  if (options.threads > 0) default_thread_pool().set_threads(options.threads);
  return {};
}

Status Session::join_world() {
  STGS_ASSIGN(world_, encoder::World::join());
  silent_ = !is_first();
  if (world_ != nullptr && options.threads == 0) {
    // Processes without a core binding of their own share the cores of the machine.
    const auto cores = static_cast<int>(sysconf(_SC_NPROCESSORS_ONLN));
    options.threads = std::clamp(cores / world_->node_size(), 1, concurrency());
    default_thread_pool().set_threads(options.threads);
  }
  return {};
}

encoder::MachineShare Session::machine_share() const {
  if (world_ == nullptr) return {};
  return {world_->node_rank(), world_->node_size()};
}

int Session::conclude(Status status) {
  if (world_ != nullptr) {
    const encoder::World::Conclusion conclusion = world_->conclude(status);
    status = conclusion.status;
    silent_ = !conclusion.should_report;
  }
  if (!status.ok() && interrupted()) {
    status = runtime_error("interrupted by {}: {}", stop_signal == SIGTERM ? "SIGTERM" : "SIGINT",
                           status.message());
  }
  if (!status.ok()) report_error(status);
  claimed_.clear();
  if (world_ != nullptr) world_->finish();
  return exit_code(status.code());
}

Status Session::claim_output(const std::string& path) {
  claimed_.push_back(std::make_shared<OutputLock>());
  return prepare_output(path, *claimed_.back(), log_sink());
}

Status Session::claim_folder(const std::string& path) {
  STGS_TRY(check_can_make_folder(path));
  claimed_.push_back(std::make_shared<OutputLock>());
  const Status taken = claimed_.back()->take(path);
  std::error_code error;
  if (taken.code() != StatusCode::kIo || !std::filesystem::is_directory(path, error)) return taken;
  // The folder above may be closed to this user, as that of a mount point.
  return claimed_.back()->take(path + "/files");
}

void Session::report_error(const Status& error) {
  const Status status(error.code(), with_url_option(error.message()));
  if (!json()) return log(0, status.message());
  if (silent_) return;
  const std::lock_guard lock(stderr_mutex_);
  clear_bar();
  const std::string out = json_text(error_json(status, arguments)) + "\n";
  write_standard_error(out);
}

Status Session::emit(const Json& json, const std::string& text) const {
  const std::string out = this->json() ? json_text(json, 1) + "\n" : printable(text);
  return write_standard_output({reinterpret_cast<const std::uint8_t*>(out.data()), out.size()});
}

void Session::emit_to_stderr(const Json& json, const std::string& text) const {
  const std::string out = this->json() ? json_text(json, 1) + "\n" : printable(text);
  write_standard_error(out);
}

void Session::log(int level, const std::string& line) {
  static constexpr const char* kNames[] = {"error: ", "warning: ", "", "debug: "};
  if (silent_ || level > level_of(options.log_level)) return;
  const std::lock_guard lock(stderr_mutex_);
  clear_bar();
  const std::string out = fmt::format("stgs: {}{}\n", kNames[std::clamp(level, 0, 3)],
                                      one_line(without_secrets(with_url_option(line), arguments)));
  write_standard_error(out);
}

encoder::LogSink Session::log_sink() {
  return [this](int level, const std::string& line) { log(level, line); };
}

encoder::ProgressSink Session::progress_sink() {
  return [this](const encoder::Progress& progress) {
    show(progress);
    return !interrupted();
  };
}

bool Session::progress(const std::string& stage, std::size_t done, std::size_t total) {
  encoder::Progress progress;
  progress.stage = stage;
  progress.done = total == 0 ? 1 : static_cast<double>(done) / static_cast<double>(total);
  progress.detail = fmt::format("{}/{}", done, total);
  show(progress);
  return !interrupted();
}

std::stop_token Session::stop_token() {
  if (!signal_watcher_.joinable()) {
    signal_watcher_ = std::jthread([stop = stop_](const std::stop_token& done) mutable {
      while (!done.stop_requested() && !interrupted()) std::this_thread::sleep_for(kSignalPoll);
      if (interrupted()) stop.request_stop();
    });
  }
  return stop_.get_token();
}

void Session::show(const encoder::Progress& progress) {
  if (silent_) return;
  const bool json_lines = options.progress == "json";
  const bool bar =
      options.progress == "bar" || (options.progress == "auto" && is_terminal_standard_error());
  if (!json_lines && !bar) return;
  const std::lock_guard lock(stderr_mutex_);
  const double now = now_seconds();
  const bool last = progress.done >= 1;
  const bool same = progress.stage == last_stage_;
  if (same && !last && now - last_shown_ < kShowInterval) return;
  last_shown_ = now;
  last_stage_ = progress.stage;
  std::string out;
  if (json_lines) {
    const double done = std::clamp(progress.done, 0.0, 1.0);
    Json line = {
        {"stage", progress.stage}, {"done", done}, {"percent", std::round(1e3 * done) / 10}};
    if (progress.eta_seconds >= 0) line["eta_seconds"] = progress.eta_seconds;
    if (!progress.detail.empty()) line["detail"] = progress.detail;
    out = json_text(line) + "\n";
  } else {
    const int filled = static_cast<int>(std::clamp(progress.done, 0.0, 1.0) * kBarWidth + 0.5);
    out = fmt::format("\r\033[K{:<10} [{:#<{}}{:.<{}}] {:3.0f} %", progress.stage, "", filled, "",
                      kBarWidth - filled, 100 * std::clamp(progress.done, 0.0, 1.0));
    if (progress.eta_seconds >= 0 && !last) {
      out += fmt::format("  {} left", duration_text(progress.eta_seconds));
    }
    if (!progress.detail.empty()) out += "  " + progress.detail;
    bar_shown_ = !last;
    if (last) out += "\n";
  }
  write_standard_error(out);
}

void Session::clear_bar() {
  if (bar_shown_) write_standard_error("\r\033[K");
  bar_shown_ = false;
}

void install_signal_handlers() {
  std::signal(SIGINT, request_stop);
  std::signal(SIGTERM, request_stop);
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
}

bool interrupted() {
  return stop_requested.load();
}

IgnoredSignals::IgnoredSignals()
    : interrupt_(std::signal(SIGINT, SIG_IGN)), terminate_(std::signal(SIGTERM, SIG_IGN)) {}

IgnoredSignals::~IgnoredSignals() {
  std::signal(SIGINT, interrupt_);
  std::signal(SIGTERM, terminate_);
}

std::uint64_t peak_memory() {
  struct rusage usage {};
  ::getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

std::string human_bytes(std::uint64_t bytes) {
  static constexpr const char* kUnits[] = {"B", "kB", "MB", "GB", "TB"};
  auto value = static_cast<double>(bytes);
  int unit = 0;
  while (value >= 999.5 && unit < 4) {
    value /= 1000;
    ++unit;
  }
  return unit == 0 ? fmt::format("{} B", bytes) : fmt::format("{:.3g} {}", value, kUnits[unit]);
}

std::string name_at_time(const std::string& file, double seconds) {
  return fmt::format("{} at {:.6g} s", file, seconds);
}

Status with_render_time(const Status& status, const std::string& file, double seconds) {
  if (status.ok()) return status;
  const std::string& message = status.message();
  const bool names_file = message.rfind(file + ": ", 0) == 0;
  // Renderers report their own failures as "FILE: cannot render 1.5 s: ...".
  const bool names_time = message.find(fmt::format(" {:.6g} s", seconds)) != std::string::npos;
  if (names_file && names_time) return status;
  if (names_file) return {status.code(), fmt::format("{} (rendering {:.6g} s)", message, seconds)};
  return {status.code(), fmt::format("{}: {}", name_at_time(file, seconds), message)};
}

double now_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace stgs::tools
