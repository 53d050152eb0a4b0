// SPDX-License-Identifier: Apache-2.0
#include "encode_windows.h"

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <future>
#include <memory>
#include <utility>
#include <vector>

#include "encode_options.h"
#include "end_after_signal.h"
#include "options.h"
#include "printable.h"
#include "stgs/encoder/stream_worker.h"

namespace stgs::tools {
namespace {

namespace fs = std::filesystem;

// Prefixes of prepared and of trained windows in the work folder.
constexpr const char* kPrepared = "window-";
constexpr const char* kTrained = "trained-";

struct EncodedWindow {
  encoder::StreamWindow window;
  double prepare_seconds = 0, train_seconds = 0;
};

Json json_of(const EncodedWindow& encoded) {
  const encoder::StreamWindow& window = encoded.window;
  return {{"first_frame", window.first_frame},
          {"frames", window.frames},
          {"iterations", window.training.iterations},
          {"primitives", window.primitives},
          {"persistent", window.persistent},
          {"bytes", window.bytes},
          {"seconds", {{"prepare", encoded.prepare_seconds}, {"train", encoded.train_seconds}}}};
}

// Waits until all processes have called, and returns their values in the order of their ranks.
template <typename T>
Result<std::vector<T>> gather(Session& session, const T& own) {
  encoder::Ranks* const world = session.world();
  std::vector<T> all(world == nullptr ? 1 : static_cast<std::size_t>(world->size()), own);
  if (world != nullptr) STGS_TRY(world->all_gather(&own, sizeof(T), all.data()));
  return all;
}

// A window that is prepared while the one before is encoded.
struct PreparedWindow {
  encoder::PreparedCapture capture;
  double seconds = 0;
};

// Windows that are trained at the same time, one by each process: window first + k by rank k.
struct Round {
  std::size_t first = 0, size = 0;
};

struct Seconds {
  double prepare = 0, train = 0;
};

// The part of a process in encoding the windows. Rank 0 has the encoder, the others a worker.
class WindowLoop {
 public:
  WindowLoop(encoder::WindowPreparer& preparer, encoder::StreamEncoder* encoder,
             encoder::StreamWorker* worker, std::string work, Session& session)
      : preparer_(preparer),
        encoder_(encoder),
        worker_(worker),
        work_(std::move(work)),
        session_(session),
        rank_(session.world() == nullptr ? 0 : static_cast<std::size_t>(session.world()->rank())),
        ranks_(session.world() == nullptr ? 1 : static_cast<std::size_t>(session.world()->size())) {
  }
  // Waits for the window in preparation.
  ~WindowLoop() { stopped_ = true; }
  WindowLoop(const WindowLoop&) = delete;
  WindowLoop& operator=(const WindowLoop&) = delete;

  // Encodes the windows that begin at this frame of the capture or later.
  Status run(int frame) {
    std::size_t i = 0;
    while (i < windows().size() && windows()[i].begin < frame) ++i;
    frames_ = frame;
    for (Round round = round_at(i); round.size > 0; round = round_at(round.first + round.size)) {
      STGS_TRY(encode(round));
      frames_ = windows()[round.first + round.size - 1].end;
    }
    return {};
  }

  // Returns the number of frames that are encoded.
  int frames() const { return frames_; }
  // Returns the windows that were encoded; none on other ranks than 0.
  const std::vector<EncodedWindow>& encoded() const { return encoded_; }

 private:
  const std::vector<encoder::FrameSpan>& windows() const { return preparer_.windows(); }

  // Returns the round that begins with a window; it is empty after the last window. The first
  // window is alone, because all others need its static content.
  Round round_at(std::size_t first) const {
    return {first, first == 0 ? 1 : std::min(ranks_, windows().size() - first)};
  }

  Status encode(const Round& round) {
    const bool takes_part = rank_ < round.size;
    PreparedWindow prepared;
    if (takes_part) {
      STGS_ASSIGN(prepared, take_prepared(round.first + rank_));
    }
    // Later windows are prepared from the analysis of the first.
    if (round.first == 0) STGS_TRY(gather(session_, 0).status());
    start_preparing(round_at(round.first + round.size));
    Seconds seconds{prepared.seconds, 0};
    std::vector<encoder::TrainedWindow> trained;
    if (takes_part) {
      const double begin = now_seconds();
      STGS_TRY(train(round, prepared, trained));
      seconds.train = now_seconds() - begin;
    }
    STGS_ASSIGN(const std::vector<Seconds> all, gather(session_, seconds));
    if (encoder_ != nullptr) STGS_TRY(append(round, std::move(trained), all));
    return gather(session_, 0).status();  // the next round needs the set
  }

  Result<PreparedWindow> take_prepared(std::size_t index) {
    Result<PreparedWindow> prepared = next_.valid() ? next_.get() : prepare(index, progress_sink());
    return prepared.ok() ? std::move(prepared)
                         : Result<PreparedWindow>(cause_of(prepared.status()));
  }

  // Starts to prepare this process's window of a round, if it has one.
  void start_preparing(const Round& round) {
    if (rank_ >= round.size) return;
    next_ = std::async(std::launch::async, [this, index = round.first + rank_] {
      return prepare(index,
                     [this](const encoder::Progress&) { return !stopped_ && !interrupted(); });
    });
  }

  Result<PreparedWindow> prepare(std::size_t index, const encoder::ProgressSink& progress) {
    const double begin = now_seconds();
    PreparedWindow out;
    const std::string folder = fmt::format("{}/{}{}-{}", work_, kPrepared, rank_, prepared_++ % 2);
    STGS_ASSIGN(out.capture,
                preparer_.prepare(index, folder, false, progress, session_.log_sink()));
    out.seconds = now_seconds() - begin;
    return out;
  }

  // Trains this process's window of a round. Rank 0 keeps it in `trained`, others write it.
  Status train(const Round& round, const PreparedWindow& prepared,
               std::vector<encoder::TrainedWindow>& trained) {
    const std::size_t index = round.first + rank_;
    const encoder::FrameSpan& span = windows()[index];
    session_.log(2, fmt::format("window {} of {}: frames {}:{}", index + 1, windows().size(),
                                span.begin, span.end));
    Result<encoder::TrainedWindow> window =
        encoder_ != nullptr
            ? encoder_->train_window(prepared.capture, progress_sink(), session_.log_sink())
            : worker_->train_window(prepared.capture, {windows()[round.first].begin, span.end},
                                    progress_sink(), session_.log_sink());
    if (!window.ok()) return cause_of(window.status());
    std::error_code ignored;
    fs::remove_all(prepared.capture.folder, ignored);
    if (encoder_ == nullptr)
      return encoder::write_trained_window(path_of(index), *window, rank_ + 1 == round.size);
    trained.push_back(*std::move(window));
    return {};
  }

  // Adds the windows of the other ranks to rank 0's, and records all of them.
  Status append(const Round& round, std::vector<encoder::TrainedWindow> trained,
                const std::vector<Seconds>& seconds) {
    for (std::size_t k = 1; k < round.size; ++k) {
      STGS_ASSIGN(encoder::TrainedWindow window,
                  encoder::read_trained_window(path_of(round.first + k), k + 1 == round.size));
      const encoder::FrameSpan& span = windows()[round.first + k];
      if (window.frames() != span.size())
        return invalid_file("{}: has {} frames (expected {}); run the same command again",
                            path_of(round.first + k), window.frames(), span.size());
      trained.push_back(std::move(window));
    }
    STGS_ASSIGN(std::vector<encoder::StreamWindow> recorded, encoder_->append(std::move(trained)));
    for (std::size_t k = 0; k < round.size; ++k) {
      if (k > 0) encoder::remove_trained_window(path_of(round.first + k));
      encoded_.push_back({std::move(recorded[k]), seconds[k].prepare, seconds[k].train});
      log_encoded(encoded_.back());
    }
    return {};
  }

  void log_encoded(const EncodedWindow& encoded) {
    const encoder::StreamWindow& window = encoded.window;
    session_.log(
        2, fmt::format("frames {}:{}: {} added, {} persistent, {}; prepare {:.1f} s, train "
                       "{:.1f} s",
                       window.first_frame, window.first_frame + window.frames,
                       plural(window.primitives, "primitive"), window.persistent,
                       human_bytes(window.bytes), encoded.prepare_seconds, encoded.train_seconds));
  }

  // Where another rank than 0 writes a trained window.
  std::string path_of(std::size_t index) const {
    return fmt::format("{}/{}{:07}", work_, kTrained, windows()[index].begin);
  }

  // Displays progress on this thread, and stops the work after a signal or an error elsewhere.
  encoder::ProgressSink progress_sink() {
    return [world = session_.world(),
            show = session_.progress_sink()](const encoder::Progress& progress) {
      return show(progress) && (world == nullptr || world->check_peers().ok());
    };
  }

  // Returns the error of another process if it has stopped this one's work.
  Status cause_of(const Status& error) {
    const Status others = session_.world() == nullptr ? Status() : session_.world()->check_peers();
    return others.ok() ? error : others;
  }

  encoder::WindowPreparer& preparer_;
  encoder::StreamEncoder* const encoder_;  // null on other ranks than 0
  encoder::StreamWorker* const worker_;    // null on rank 0
  const std::string work_;
  Session& session_;
  const std::size_t rank_, ranks_;
  int frames_ = 0;
  std::size_t prepared_ = 0;
  std::vector<EncodedWindow> encoded_;
  std::atomic<bool> stopped_{false};
  std::future<Result<PreparedWindow>> next_;  // last: its destructor waits for the thread
};

// Removes the windows of killed runs, also incomplete ones, from a folder of this verb.
void remove_leftovers(const std::string& work) {
  std::error_code ignored;
  std::vector<fs::path> found;
  fs::directory_iterator entries(work, ignored);
  for (; !ignored && entries != fs::directory_iterator(); entries.increment(ignored)) {
    std::string name = entries->path().filename().string();
    if (name.starts_with('.')) name.erase(0, 1);
    if (name.starts_with(kPrepared) || name.starts_with(kTrained)) found.push_back(entries->path());
  }
  for (const fs::path& path : found) fs::remove_all(path, ignored);
}

// Opens the folder for the first process.
Result<std::unique_ptr<encoder::StreamEncoder>> open_encoder(
    const std::string& work, const encoder::StreamSettings& settings, Session& session) {
  std::error_code error;
  fs::create_directories(work, error);
  if (error) return io_error("{}: cannot create: {}", work, error.message());
  STGS_TRY(session.claim_folder(work));
  Result<std::unique_ptr<encoder::StreamEncoder>> opened =
      encoder::StreamEncoder::open(work, settings);
  if (!opened.ok()) {
    fs::remove(work, error);  // if it is empty
    return opened;
  }
  remove_leftovers(work);
  if ((*opened)->frames() > 0) {
    session.log(2, fmt::format("{}: resuming after frame {}", work, (*opened)->frames()));
  }
  return opened;
}

Status print_result(const std::vector<EncodedWindow>& encoded, std::uint64_t persistent,
                    double pack_seconds, const std::string& output, const std::string& work,
                    Session& session) {
  STGS_ASSIGN(const auto reader, SceneReader::open(output));
  const std::uint64_t primitives = reader->primitives(), bytes = reader->file_bytes();
  const double each = static_cast<double>(bytes) / std::max(1.0, static_cast<double>(primitives));
  double prepare = 0, train = 0;
  Json windows = Json::array();
  for (const EncodedWindow& window : encoded) {
    prepare += window.prepare_seconds;
    train += window.train_seconds;
    windows.push_back(json_of(window));
  }
  const Json json = {{"output", output},
                     {"primitives", primitives},
                     {"bytes", bytes},
                     {"bytes_per_primitive", each},
                     {"seconds", {{"prepare", prepare}, {"train", train}, {"pack", pack_seconds}}},
                     {"train", nullptr},
                     {"pack", nullptr},
                     {"windows", windows},
                     {"report", nullptr},
                     {"work", work.empty() ? Json(nullptr) : Json(work)},
                     {"peak_memory", peak_memory()}};
  return session.emit(
      json,
      fmt::format("{}: {} frames, {} ({} persistent), {}, {:.1f} bytes per primitive\n"
                  "prepare {:.1f} s, train {:.1f} s ({}), finish {:.1f} s, peak memory {}\n",
                  one_line(output), reader->metadata().frames, plural(primitives, "primitive"),
                  persistent, human_bytes(bytes), each, prepare, train,
                  plural(encoded.size(), "window"), pack_seconds, human_bytes(peak_memory())));
}

}  // namespace

Status encode_windows(encoder::WindowPreparer& preparer, const encoder::StreamSettings& settings,
                      const std::string& work, bool keep_work, const std::string& output,
                      Session& session) {
  std::unique_ptr<encoder::StreamEncoder> encoder;
  std::unique_ptr<encoder::StreamWorker> worker;
  if (session.is_first()) {
    STGS_ASSIGN(encoder, open_encoder(work, settings, session));
  }
  STGS_ASSIGN(const std::vector<int> frames, gather(session, encoder ? encoder->frames() : 0));
  if (!session.is_first()) {
    STGS_ASSIGN(worker, encoder::StreamWorker::open(work, settings));
  }
  preparer.keep_analysis(work + "/first-window.analysis");
  WindowLoop loop(preparer, encoder.get(), worker.get(), work, session);
  const Status encoded = loop.run(frames.front());
  if (encoded.code() == StatusCode::kRuntime && interrupted()) {
    return runtime_error("{}: incomplete; run the same command again to continue after frame {}",
                         output, loop.frames());
  }
  STGS_TRY(encoded);
  if (!session.is_first()) return {};
  const double begin = now_seconds();
  STGS_TRY(encoder->finish(output));
  const std::uint64_t persistent = encoder->persistent();
  if (!keep_work) encoder->remove_files();
  return print_result(loop.encoded(), persistent, now_seconds() - begin, output,
                      keep_work ? work : "", session);
}

}  // namespace stgs::tools
