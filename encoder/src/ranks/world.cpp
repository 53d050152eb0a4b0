// SPDX-License-Identifier: Apache-2.0
// Ranks over MPI. A rank that fails sends a note to every other rank. Waiting ranks poll for notes,
// so that all stop with the same error and none waits forever.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <climits>
#include <cstdint>
#include <cstring>
#include <optional>
#include <thread>
#include <vector>

#include "ranks/mpi_module.h"
#include "stgs/encoder/program_module.h"
#include "stgs/encoder/ranks.h"

namespace stgs::encoder {
namespace {

constexpr const char* kModule = "stgs_mpi.so";
// How long failed ranks wait for the final notes of the others, and then to be aborted.
constexpr auto kFailureTimeout = std::chrono::seconds(10);
// A gather polls all the time at first, because those of a training step are short, then in
// intervals: ranks that train windows wait for minutes, and need their cores for other ranks.
constexpr auto kBusyTime = std::chrono::milliseconds(50);
constexpr auto kPollInterval = std::chrono::milliseconds(1);

// The final status of a rank.
struct Note {
  std::int32_t code = 0;
  std::int32_t own = 0;      // the error originated on this rank
  std::int32_t waiting = 0;  // a gather is incomplete
  char host[60] = "";
  char text[2000] = "";
};

template <std::size_t kSize>
void copy_text(const std::string& text, char (&to)[kSize]) {
  const std::size_t n = std::min(text.size(), kSize - 1);
  std::memcpy(to, text.data(), n);
  to[n] = '\0';
}

class MpiWorld final : public World {
 public:
  Status load();
  Status init(const Launch& launch);

  int rank() const override { return rank_; }
  int size() const override { return size_; }
  int node_rank() const override { return node_rank_; }
  int node_size() const override { return node_size_; }
  Status all_gather(const void* own, std::size_t bytes, void* all) override;
  Status check_peers() override;
  Conclusion conclude(const Status& own) override;
  void finish() override;

 private:
  Status mpi_status(int error, const char* operation) const;
  // Receives all notes that have arrived.
  Status read_notes();
  Status status_of(int rank) const;
  bool all_have_concluded() const;

  const MpiFunctions* mpi_ = nullptr;
  int rank_ = 0, size_ = 1, node_rank_ = 0, node_size_ = 1;
  std::vector<std::uint8_t> sent_, received_;
  Note own_;
  std::vector<std::optional<Note>> notes_;  // of every rank
  bool waiting_ = false, failed_ = false;   // failed_: another rank has failed
  int abort_code_ = 0;                      // exit code if all ranks must be aborted; 0: none
};

Status MpiWorld::load() {
  // Global, because MPI implementations load plugins that need their symbols.
  STGS_ASSIGN(void* const symbol, load_program_module(kModule, kMpiSymbol, true));
  mpi_ = reinterpret_cast<MpiSymbol>(symbol)();
  return {};
}

Status MpiWorld::init(const Launch& launch) {
  STGS_TRY(mpi_status(mpi_->init(&rank_, &size_, &node_rank_, &node_size_), "starting"));
  if (size_ != launch.size) {
    return unsupported(
        "MPI sees {} process{} instead of the {} that {} started; use the mpirun of the MPI that "
        "this "
        "program was built with, or srun --mpi=pmix",
        size_, size_ == 1 ? "" : "es", launch.size, launch.launcher);
  }
  notes_.resize(static_cast<std::size_t>(size_));
  char host[sizeof(own_.host)] = "";
  ::gethostname(host, sizeof(host) - 1);
  copy_text(host, own_.host);
  return {};
}

Status MpiWorld::mpi_status(int error, const char* operation) const {
  if (error == 0) return {};
  char text[512] = "";
  mpi_->describe(error, text, sizeof(text));
  return runtime_error("MPI failed while {}: {}", operation, text);
}

Status MpiWorld::read_notes() {
  for (;;) {
    Note note;
    int from = -1;
    STGS_TRY(mpi_status(mpi_->note_poll(&from, &note, sizeof(note)), "reading a note"));
    if (from < 0) return {};
    note.text[sizeof(note.text) - 1] = note.host[sizeof(note.host) - 1] = '\0';
    notes_[static_cast<std::size_t>(from)] = note;
    failed_ = failed_ || note.code != 0;
  }
}

Status MpiWorld::status_of(int rank) const {
  const Note& note = *notes_[static_cast<std::size_t>(rank)];
  return {static_cast<StatusCode>(note.code),
          fmt::format("process {} of {}, on {}: {}", rank + 1, size_, note.host, note.text)};
}

Status MpiWorld::check_peers() {
  STGS_TRY(read_notes());
  for (int r = 0; r < size_; ++r) {
    const std::optional<Note>& note = notes_[static_cast<std::size_t>(r)];
    if (note && note->code != 0) return status_of(r);
  }
  return {};
}

Status MpiWorld::all_gather(const void* own, std::size_t bytes, void* all) {
  STGS_TRY(check_peers());
  // Uses internal buffers, because MPI may still write to them after an error ended the wait.
  const auto* from = static_cast<const std::uint8_t*>(own);
  sent_.assign(from, from + bytes);
  received_.resize(bytes * static_cast<std::size_t>(size_));
  STGS_TRY(mpi_status(mpi_->gather_begin(sent_.data(), bytes, received_.data()), "gathering"));
  waiting_ = true;
  const auto begin = std::chrono::steady_clock::now();
  for (;;) {
    int done = 0;
    STGS_TRY(mpi_status(mpi_->gather_done(&done), "gathering"));
    if (done != 0) break;
    STGS_TRY(check_peers());
    if (std::chrono::steady_clock::now() - begin < kBusyTime) {
      std::this_thread::yield();
    } else {
      std::this_thread::sleep_for(kPollInterval);
    }
  }
  waiting_ = false;
  if (bytes > 0) std::memcpy(all, received_.data(), received_.size());
  return {};
}

bool MpiWorld::all_have_concluded() const {
  return std::all_of(notes_.begin(), notes_.end(), [](const auto& note) { return note; });
}

World::Conclusion MpiWorld::conclude(const Status& own) {
  own_.code = static_cast<std::int32_t>(own.code());
  own_.own = !own.ok() && !failed_;
  own_.waiting = waiting_;
  copy_text(own.message(), own_.text);
  notes_[static_cast<std::size_t>(rank_)] = own_;
  Status mpi = mpi_status(mpi_->note_send(&own_, sizeof(own_)), "sending a note");
  // A healthy rank may take long to write its files, so the timeout starts at the first error.
  std::optional<std::chrono::steady_clock::time_point> failure;
  while (mpi.ok() && !all_have_concluded()) {
    mpi = read_notes();
    const auto now = std::chrono::steady_clock::now();
    if (!failure && (failed_ || !own.ok())) failure = now;
    if (failure && now - *failure > kFailureTimeout) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }

  int source = -1, reporter = 0;  // lowest rank with its own error; lowest rank with a note
  bool identical = true, must_abort = !mpi.ok() || !all_have_concluded();
  for (int r = size_ - 1; r >= 0; --r) {
    const std::optional<Note>& note = notes_[static_cast<std::size_t>(r)];
    identical = identical && note && std::strcmp(note->text, own_.text) == 0;
    must_abort = must_abort || note->waiting != 0;
    if (!note) continue;
    reporter = r;
    if (note->code != 0 && (note->own != 0 || source < 0)) source = r;
  }
  Conclusion conclusion{own, reporter == rank_};
  if (source >= 0 && !(source == rank_ && identical)) conclusion.status = status_of(source);
  if (identical) conclusion.status = own;
  if (conclusion.status.ok() && !mpi.ok()) conclusion.status = mpi;
  if (must_abort) abort_code_ = std::max(1, static_cast<int>(conclusion.status.code()));
  return conclusion;
}

void MpiWorld::finish() {
  if (abort_code_ == 0) {
    (void)mpi_->finalize();
    return;
  }
  // Rank 0 aborts all; the others do so only if it does not.
  if (rank_ != 0) std::this_thread::sleep_for(kFailureTimeout);
  mpi_->abort(abort_code_);
}

}  // namespace

bool World::is_built() {
  return STGS_HAS_MPI;
}

Result<std::unique_ptr<World>> World::join() {
  const Launch launch = detect_launch();
  if (launch.size == 1) return std::unique_ptr<World>();
  if (!is_built()) {
    return not_built(
        "{} started {} processes, but this build has no MPI; build with an MPI installed "
        "(STGS_WITH_MPI), or start a single process",
        launch.launcher, launch.size);
  }
  if (launch.size > kMaxRanks) {
    return unsupported("{} started {} processes; at most {} can train together", launch.launcher,
                       launch.size, kMaxRanks);
  }
  auto world = std::make_unique<MpiWorld>();
  STGS_TRY(world->load());
  STGS_TRY(world->init(launch));
  return std::unique_ptr<World>(std::move(world));
}

}  // namespace stgs::encoder
