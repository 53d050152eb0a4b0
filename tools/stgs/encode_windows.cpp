// SPDX-License-Identifier: Apache-2.0
#include "encode_windows.h"

#include <atomic>
#include <filesystem>
#include <future>

#include "encode_options.h"
#include "end_after_signal.h"
#include "options.h"
#include "printable.h"

namespace stgs::tools {
namespace {

namespace fs = std::filesystem;

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

// A window that is prepared while the one before is encoded.
struct PreparedWindow {
  encoder::PreparedCapture capture;
  double seconds = 0;
};

class WindowLoop {
 public:
  WindowLoop(encoder::WindowPreparer& preparer, encoder::StreamEncoder& encoder, std::string work,
             Session& session)
      : preparer_(preparer), encoder_(encoder), work_(std::move(work)), session_(session) {}
  // Waits for the window in preparation.
  ~WindowLoop() { stopped_ = true; }
  WindowLoop(const WindowLoop&) = delete;
  WindowLoop& operator=(const WindowLoop&) = delete;

  Status run() {
    const std::vector<encoder::FrameSpan>& windows = preparer_.windows();
    std::size_t i = 0;
    while (i < windows.size() && windows[i].begin < encoder_.frames()) ++i;
    if (i == windows.size()) return {};
    Result<PreparedWindow> prepared = prepare(i, session_.progress_sink());
    for (; i < windows.size(); ++i) {
      STGS_TRY(prepared.status());
      if (i + 1 < windows.size()) {
        next_ = std::async(std::launch::async, [this, i] {
          return prepare(i + 1,
                         [this](const encoder::Progress&) { return !stopped_ && !interrupted(); });
        });
      }
      STGS_TRY(encode(i, *prepared));
      if (next_.valid()) prepared = next_.get();
    }
    return {};
  }

  const std::vector<EncodedWindow>& encoded() const { return encoded_; }

 private:
  Result<PreparedWindow> prepare(std::size_t index, const encoder::ProgressSink& progress) {
    const double begin = now_seconds();
    PreparedWindow out;
    STGS_ASSIGN(out.capture, preparer_.prepare(index, fmt::format("{}/window-{}", work_, index % 2),
                                               false, progress, session_.log_sink()));
    out.seconds = now_seconds() - begin;
    return out;
  }

  Status encode(std::size_t index, const PreparedWindow& prepared) {
    const encoder::FrameSpan& span = preparer_.windows()[index];
    session_.log(2, fmt::format("window {} of {}: frames {}:{}", index + 1,
                                preparer_.windows().size(), span.begin, span.end));
    const double begin = now_seconds();
    EncodedWindow out;
    out.prepare_seconds = prepared.seconds;
    STGS_ASSIGN(out.window,
                encoder_.encode(prepared.capture, session_.progress_sink(), session_.log_sink()));
    out.train_seconds = now_seconds() - begin;
    std::error_code ignored;
    fs::remove_all(prepared.capture.folder, ignored);
    session_.log(
        2, fmt::format("frames {}:{}: {} added, {} persistent, {}; prepare {:.1f} s, train "
                       "{:.1f} s",
                       span.begin, span.end, plural(out.window.primitives, "primitive"),
                       out.window.persistent, human_bytes(out.window.bytes), out.prepare_seconds,
                       out.train_seconds));
    encoded_.push_back(std::move(out));
    return {};
  }

  encoder::WindowPreparer& preparer_;
  encoder::StreamEncoder& encoder_;
  const std::string work_;
  Session& session_;
  std::vector<EncodedWindow> encoded_;
  std::atomic<bool> stopped_{false};
  std::future<Result<PreparedWindow>> next_;  // last: its destructor waits for the thread
};

// Removes the prepared windows of killed runs, also incomplete ones, from a folder of this verb.
void remove_prepared(const std::string& work) {
  std::error_code ignored;
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(work, ignored)) {
    const std::string name = entry.path().filename().string();
    const std::size_t at = name.starts_with('.') ? 1 : 0;
    if (name.compare(at, 8, "window-0") == 0 || name.compare(at, 8, "window-1") == 0)
      found.push_back(entry.path());
  }
  for (const fs::path& path : found) fs::remove_all(path, ignored);
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
  std::error_code error;
  fs::create_directories(work, error);
  if (error) return io_error("{}: cannot create: {}", work, error.message());
  STGS_TRY(session.claim_folder(work));
  Result<std::unique_ptr<encoder::StreamEncoder>> opened =
      encoder::StreamEncoder::open(work, settings);
  if (!opened.ok()) fs::remove(work, error);  // if it is empty
  STGS_ASSIGN(const std::unique_ptr<encoder::StreamEncoder> encoder, std::move(opened));
  remove_prepared(work);
  if (encoder->frames() > 0) {
    session.log(2, fmt::format("{}: resuming after frame {}", work, encoder->frames()));
  }
  preparer.keep_analysis(work + "/first-window.analysis");
  WindowLoop loop(preparer, *encoder, work, session);
  const Status encoded = loop.run();
  if (!encoded.ok() && interrupted()) {
    return runtime_error("{}: incomplete; run the same command again to continue after frame {}",
                         output, encoder->frames());
  }
  STGS_TRY(encoded);
  const double begin = now_seconds();
  STGS_TRY(encoder->finish(output));
  const std::uint64_t persistent = encoder->persistent();
  if (!keep_work) encoder->remove_files();
  return print_result(loop.encoded(), persistent, now_seconds() - begin, output,
                      keep_work ? work : "", session);
}

}  // namespace stgs::tools
