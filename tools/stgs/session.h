// SPDX-License-Identifier: Apache-2.0
// State shared by the verbs: common options, results on standard output, messages and progress on
// standard error, and interruption.
#pragma once

#include <concepts>
#include <cstdint>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "stgs/encoder/progress.h"
#include "stgs/encoder/ranks.h"
#include "stgs/format/status.h"

namespace stgs {
class OutputLock;
}

namespace stgs::tools {

using Json = nlohmann::ordered_json;

// Returns JSON as text in ASCII: other characters are escaped, so that none controls a terminal.
// Bytes that are not UTF-8, for example in a file name, become U+FFFD.
std::string json_text(const Json& json, int indent = -1);

struct CommonOptions {
  std::string format = "text";     // text or json
  std::string progress = "auto";   // auto, bar, json or none
  std::string log_level = "info";  // error, warning, info or debug
  std::string backend = "auto";
  std::string config;          // never set: the program handles it
  int threads = 0;             // 0: all
  std::uint64_t seed = 1;      // for all random choices
  double timeout = 60;         // of a read from a URL, seconds
  bool allow_private = false;  // URLs may lead to private networks
};

class Session {
 public:
  CommonOptions options;
  std::string command;                 // the command line, quoted for a shell
  std::vector<std::string> arguments;  // of the command line, without the program

  // Applies --threads. Call once, before any work. The limit lasts as long as the session.
  Status start();

  // Joins the other processes if mpirun or srun has started several. All processes but the first
  // are silent from then on. Sets options.threads to their share of the cores, unless it is set.
  Status join_world();
  // Null if this is the only process.
  encoder::Ranks* world() const { return world_.get(); }
  // Returns the part of this machine that this process uses.
  encoder::MachineShare machine_share() const;
  bool is_first() const { return world_ == nullptr || world_->rank() == 0; }
  // Ends the verb: agrees on one status with the other processes and reports it from one of them.
  // Releases what was claimed. Returns the exit code.
  int conclude(Status status);

  // Prepares an output before long work (prepare_output()), and makes this run the only one that
  // writes it, until the session ends. One thread at a time.
  Status claim_output(const std::string& path);
  // As claim_output(), for a new or existing folder. The lock is next to it, or in it if the folder
  // above cannot be written.
  Status claim_folder(const std::string& path);

  bool json() const { return options.format == "json"; }
  // Prints the result to standard output, as JSON or text. Control characters in text are escaped,
  // here and in log() (printable.h).
  Status emit(const Json& json, const std::string& text) const;
  // Prints the result to standard error, for verbs whose standard output carries a video stream.
  void emit_to_stderr(const Json& json, const std::string& text) const;

  // Prints an error to standard error: as JSON with --format json, else as a line of text.
  void report_error(const Status& error);
  // Thread-safe. Levels as in LogSink: 0 error, 1 warning, 2 information, 3 debug.
  void log(int level, const std::string& line);
  encoder::LogSink log_sink();
  // Displays progress as --progress selects. Returns false after SIGINT or SIGTERM.
  encoder::ProgressSink progress_sink();
  // Reports that `done` of `total` steps of a stage are complete. Returns false to stop.
  bool progress(const std::string& stage, std::size_t done, std::size_t total);
  // Returns a token that SIGINT and SIGTERM trigger, for blocking operations.
  std::stop_token stop_token();

 private:
  void show(const encoder::Progress& progress);
  void clear_bar();

  std::unique_ptr<encoder::World> world_;
  std::vector<std::shared_ptr<OutputLock>> claimed_;
  std::mutex stderr_mutex_;  // guards standard error and the state of the progress bar
  bool silent_ = false;
  bool bar_shown_ = false;
  double last_shown_ = -1;  // seconds of the monotonic clock
  std::string last_stage_;
  std::stop_source stop_;
  std::jthread signal_watcher_;  // runs once stop_token() has been called
};

// Handles SIGINT and SIGTERM: the first asks the work to stop, the second ends the program. Ignores
// SIGPIPE and SIGXFSZ, so that a failed write is an error with a message.
void install_signal_handlers();
// Returns whether SIGINT or SIGTERM has arrived.
bool interrupted();

// While it exists, SIGINT and SIGTERM have no effect: between two steps that belong together. The
// main thread creates it, after install_signal_handlers().
class IgnoredSignals {
 public:
  IgnoredSignals();
  ~IgnoredSignals();
  IgnoredSignals(const IgnoredSignals&) = delete;
  IgnoredSignals& operator=(const IgnoredSignals&) = delete;

 private:
  void (*interrupt_)(int);
  void (*terminate_)(int);
};

// Returns the largest resident memory of this process so far, in bytes.
std::uint64_t peak_memory();
// Formats bytes with decimal units: 1234567 -> "1.23 MB".
std::string human_bytes(std::uint64_t bytes);
// Formats a count with its noun: "1 frame", "12 frames"; `noun` is a singular that takes an s.
std::string plural(std::integral auto count, const char* noun) {
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}
// Returns "FILE at 1.5 s", for messages.
std::string name_at_time(const std::string& file, double seconds);
// Adds the file and the time to the message of a failed render. Passes success through.
Status with_render_time(const Status& status, const std::string& file, double seconds);
// Seconds of the monotonic clock.
double now_seconds();

}  // namespace stgs::tools
