// SPDX-License-Identifier: Apache-2.0
// What the verbs share: the common options, results on standard output, messages and progress on
// standard error, and interruption.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <stop_token>
#include <string>
#include <thread>

#include "stgs/encoder/progress.h"
#include "stgs/encoder/ranks.h"
#include "stgs/format/status.h"

namespace stgs::tools {

using Json = nlohmann::ordered_json;

// JSON as text. Bytes that are not UTF-8, as a file's name may hold, become U+FFFD.
std::string json_text(const Json& json, int indent = -1);

struct CommonOptions {
  std::string format = "text";     // text or json
  std::string progress = "auto";   // auto, bar, json or none
  std::string log_level = "info";  // error, warning, info or debug
  std::string backend = "auto";
  int threads = 0;         // 0: all
  std::uint64_t seed = 1;  // of whatever is random
};

class Session {
 public:
  CommonOptions options;
  std::string command;  // as a shell would take it

  // Applies --threads; call once, before any work. The limit lasts as long as the session.
  Status start();

  // Joins the other processes where mpirun or srun has started several; all but the first are
  // silent from then on.
  Status join_world();
  // Null where this process is alone.
  encoder::Ranks* world() const { return world_.get(); }
  bool is_first() const { return world_ == nullptr || world_->rank() == 0; }
  // The end of the verb's work: what all processes have come to, told by one of them. Returns the
  // exit code.
  int conclude(Status status);

  bool json() const { return options.format == "json"; }
  // Prints the result, as JSON or text, to standard output. Of text, here and in log(), control
  // characters are escaped (printable.h).
  Status emit(const Json& json, const std::string& text) const;
  // The same to standard error, for verbs whose standard output carries a picture stream.
  void emit_aside(const Json& json, const std::string& text) const;

  // Any thread may call this. Levels as LogSink: 0 errors, 1 warnings, 2 information, 3 details.
  void log(int level, const std::string& line);
  encoder::LogSink log_sink();
  // Shows progress as asked for; tells the work to stop after SIGINT or SIGTERM.
  encoder::ProgressSink progress_sink();
  // One step of `total` of a stage has been done; false: stop.
  bool progress(const std::string& stage, std::size_t done, std::size_t total);
  // Is told to stop by SIGINT or SIGTERM, for what waits.
  std::stop_token stop_token();

 private:
  void limit_threads(int threads);
  void show(const encoder::Progress& progress);
  void clear_bar();

  std::unique_ptr<encoder::World> world_;
  std::mutex showing_;  // standard error, and what is shown there
  bool silent_ = false;
  std::shared_ptr<void> thread_limit_;
  bool bar_shown_ = false;
  double last_shown_ = -1;  // seconds of the monotonic clock
  std::string last_stage_;
  std::stop_source stop_;
  std::jthread watcher_;  // of the signals, where stop_token() is asked for
};

// Catches SIGINT and SIGTERM: the first asks the work to stop, the second ends the program. Ignores
// SIGPIPE and SIGXFSZ, so that a failing write is an error with a message.
void install_signal_handlers();
bool interrupted();

// Largest resident memory of this process so far, bytes.
std::uint64_t peak_memory();
// 1234567 -> "1.2 MB"; decimal units.
std::string human_bytes(std::uint64_t bytes);
// "FILE at 1.5 s", for messages.
std::string moment_name(const std::string& file, double seconds);
// The status of drawing a file at a moment; an error's message then says which file and when.
Status at_moment(const Status& status, const std::string& file, double seconds);
// Seconds of the monotonic clock.
double now_seconds();

}  // namespace stgs::tools
