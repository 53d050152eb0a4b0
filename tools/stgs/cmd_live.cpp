// SPDX-License-Identifier: Apache-2.0
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>
#include <vector>

#include "allow_outside.h"
#include "arguments.h"
#include "command.h"
#include "encode_options.h"
#include "opencv.h"
#include "options.h"
#include "output_path.h"
#include "printable.h"
#include "stgs/encoder/live_encoder.h"
#include "stgs/format/temporary.h"
#include "usage.h"
#include "video_decoder_option.h"

namespace stgs::tools {
namespace {

namespace fs = std::filesystem;

constexpr auto kPoll = std::chrono::milliseconds(50);

Json json_of(const encoder::LiveWindow& window) {
  return {{"first_frame", window.first_frame},
          {"frames", window.frames},
          {"missing", window.missing},
          {"scale", window.scale},
          {"point_interval", window.point_interval},
          {"iterations", window.iterations},
          {"primitives", window.primitives},
          {"persistent", window.persistent},
          {"bytes", window.bytes},
          {"loss", window.loss},
          {"psnr", window.psnr == 0 ? Json() : Json(window.psnr)},
          {"prepare_seconds", window.prepare_seconds},
          {"train_seconds", window.train_seconds},
          {"latency", window.latency},
          {"waiting", window.waiting},
          {"written", window.written}};
}

// The threads that read the sources.
class Sources {
 public:
  Sources(encoder::LivePreparer& preparer, encoder::LiveEncoder& live, Session& session)
      : ended_(preparer.cameras().size()) {
    for (std::size_t c = 0; c < ended_.size(); ++c) {
      threads_.emplace_back([this, c, &preparer, &live, &session] {
        const Status status = preparer.read_source(
            c,
            [&live](std::size_t camera, double seconds, encoder::Image8 frame) {
              live.push(camera, seconds, std::move(frame));
            },
            [this] { return stopped_.load(); }, session.log_sink());
        if (!status.ok() && !stopped_) session.log(1, status.message());
        live.end_camera(c);
        ended_[c] = true;
      });
    }
  }
  ~Sources() { stop(); }
  Sources(const Sources&) = delete;
  Sources& operator=(const Sources&) = delete;

  bool ended() const {
    return std::all_of(ended_.begin(), ended_.end(),
                       [](const auto& ended) { return ended.load(); });
  }
  void stop() {
    stopped_ = true;
    for (std::thread& thread : threads_)
      if (thread.joinable()) thread.join();
  }

 private:
  std::atomic<bool> stopped_{false};
  std::vector<std::atomic<bool>> ended_;
  std::vector<std::thread> threads_;
};

class Live final : public Command {
 public:
  Help help() const override {
    return {
        "live", "Encode a rig while it films",
        "Reads the cameras of RIG and writes a .stgs file that players can follow while it grows.\n"
        "RIG is a file in the format of cameras.json with a \"source\" for each camera: a folder\n"
        "into which images are written, a named pipe, a video, or a URL (rtsp, rtp, udp, tcp,\n"
        "http, https). RIG can also be the folder of a recorded capture, which is played at its\n"
        "own rate. The cameras must be calibrated.\n"
        "The work per window is chosen so that encoding keeps up. Cameras may stall and return.\n"
        "Encoding ends when all sources have ended, after --duration, or with Ctrl-C, and then\n"
        "completes the file.",
        "  stgs live rig/cameras.json -o live.stgs\n"
        "  stgs live capture/ -o live.stgs --fps 30 --duration 60 --log windows.jsonl"};
  }
  Shared shared() const override {
    Shared shared = encoder_shared("Backend of preparation and training");
    shared.progress = false;
    return shared;
  }
  void declare(Arguments& app) override {
    app.add_option("RIG", rig_, "Calibration of the rig (cameras.json), or a folder")->required();
    app.add_option("-o,--output", output_, "Output file (.stgs), which must not exist")->required();
    app.add_option("--fps", fps_,
                   "Frames per second (default: the value of the calibration or of its videos)")
        ->check(number_between(encoder::kLiveFps.min, encoder::kLiveFps.max));
    app.add_option(
           "--latency", settings_.latency,
           "Target from filming a frame to writing it, seconds; a third of it is the length "
           "of a window, at least 8 frames")
        ->check(number_between(encoder::kLiveLatency.min, encoder::kLiveLatency.max))
        ->capture_default_str();
    app.add_option("--target-kbps", settings_.target_kbps,
                   "Limit of the mean bit rate once static content is stored (default: no limit), "
                   "kbit/s")
        ->check(number_between(encoder::kLiveKbps.min, encoder::kLiveKbps.max));
    app.add_option("--duration", duration_, "End after this time (default: no limit), seconds")
        ->check(number_between(0.1, 1e7));
    app.add_option("--log", log_path_, "Write a line of JSON for each window to this file");
    with_choices(app.add_option("--preset", preset_,
                                "Upper limit of the work per window: fast, default or best"),
                 {"fast", "default", "best"})
        ->capture_default_str();
    app.add_option("--max-primitives", max_primitives_,
                   "Maximum number of primitives of a window, with the persistent ones (default: "
                   "the value of the preset)")
        ->check(number_between(1, 2e8));
    app.add_option(
           "--scale", prepare_.scale,
           "Largest scale factor of the images, which become smaller if encoding is too slow")
        ->check(number_between(0.01, 1))
        ->capture_default_str();
    app.add_option("--title", settings_.stream.title, "Metadata: title of the scene");
    app.add_flag("--trust-calibration", prepare_.trust_calibration,
                 "Only warn if a mistake in the calibration is found");
    add_allow_outside(app, prepare_.allow_outside);
    add_video_decoder(app, prepare_.video_decoder);
  }

  Status run(Session& session) override {
    STGS_TRY(check_extension(output_, "live", ".stgs"));
    STGS_TRY(check_distinct({{"--output", output_}, {"--log", log_path_}}));
    STGS_TRY(session.claim_output(output_));
    if (fs::exists(output_)) {
      return usage_error(
          "{}: exists; name another file, or remove it (stgs finalize completes a "
          "recording that was cut off)",
          output_);
    }
    if (!log_path_.empty()) STGS_TRY(session.claim_output(log_path_));
    prepare_.seed = session.options.seed;
    prepare_.backend = session.options.backend;
    STGS_ASSIGN(const auto preparer, open_live(rig_, prepare_, fps_, session));
    STGS_TRY(preparer->check_sources());
    WorkFolder folder;
    STGS_TRY(folder.create(output_));
    const std::string work = folder.path() + "/live";
    fs::create_directory(work);
    if (!log_path_.empty()) log_.open(log_path_);
    STGS_ASSIGN(const auto live, open_encoder(*preparer, work, session));
    session.log(2, fmt::format("{}: {} at {:.6g} fps; Ctrl-C ends the recording", rig_,
                               plural(preparer->cameras().size(), "camera"), preparer->fps()));
    {
      Sources sources(*preparer, *live, session);
      const double begin = now_seconds();
      while (!sources.ended() && !interrupted() && !live->ended() &&
             (duration_ == 0 || now_seconds() - begin < duration_))
        std::this_thread::sleep_for(kPoll);
    }
    const Status finished = live->finish(output_);
    if (!finished.ok()) return with_remains(finished);
    if (log_.is_open() && !log_.flush()) session.log(1, log_path_ + ": incomplete (disk full?)");
    return print(live->report(), session);
  }

 private:
  Result<std::unique_ptr<encoder::LiveEncoder>> open_encoder(encoder::LivePreparer& preparer,
                                                             const std::string& work,
                                                             Session& session) {
    encoder::TrainSettings& train = settings_.stream.train;
    train.preset = preset_;
    train.max_primitives = max_primitives_;
    train.seed = session.options.seed;
    train.backend = session.options.backend;
    settings_.stream.recording = output_;
    return encoder::LiveEncoder::open(
        preparer, work, settings_,
        [this, &session](const encoder::LiveWindow& window) { report_window(window, session); },
        session.log_sink());
  }

  void report_window(const encoder::LiveWindow& window, Session& session) {
    if (log_.is_open()) log_ << json_text(json_of(window)) << '\n' << std::flush;
    const std::string psnr = window.psnr == 0 ? "" : fmt::format(", {:.1f} dB", window.psnr);
    session.log(2, fmt::format("frames {}:{}: latency {:.2f} s, {}{}, {}, {} ({} waiting)",
                               window.first_frame, window.first_frame + window.frames,
                               window.latency, plural(window.iterations, "step"), psnr,
                               plural(window.primitives, "primitive"), human_bytes(window.bytes),
                               window.waiting));
  }

  // Adds the recording that remains to an error.
  Status with_remains(const Status& error) const {
    if (!fs::exists(output_)) return error;
    return {error.code(),
            fmt::format("{}; {} has the windows before, and stgs finalize completes it",
                        error.message(), output_)};
  }

  Status print(const encoder::LiveReport& report, Session& session) const {
    const std::uint64_t bytes = fs::file_size(output_);
    const Json json = {{"output", output_},
                       {"cameras", report.cameras},
                       {"frames", report.frames},
                       {"windows", report.windows},
                       {"lost_frames", report.lost_frames},
                       {"images",
                        {{"received", report.received},
                         {"dropped", report.dropped},
                         {"late", report.late},
                         {"repeated", report.repeated},
                         {"ahead", report.ahead},
                         {"overflow", report.overflow},
                         {"missing", report.missing}}},
                       {"primitives", report.primitives},
                       {"persistent", report.persistent},
                       {"bytes", bytes},
                       {"psnr", report.psnr == 0 ? Json() : Json(report.psnr)},
                       {"scale", report.scale},
                       {"latency",
                        {{"median", report.latency_median},
                         {"p95", report.latency_p95},
                         {"max", report.latency_max}}},
                       {"peak_memory", peak_memory()}};
    return session.emit(
        json, fmt::format(
                  "{}: {} of {}, {} ({} persistent), {}\ntraining images {:.2f} dB, scale {:.3g}; "
                  "latency {:.2f} s, 95 % within {:.2f} s; "
                  "{} dropped, {} missing, {} lost; peak memory {}\n",
                  one_line(output_), plural(report.frames, "frame"),
                  plural(report.cameras, "camera"), plural(report.primitives, "primitive"),
                  report.persistent, human_bytes(bytes), report.psnr, report.scale,
                  report.latency_median, report.latency_p95, plural(report.dropped, "image"),
                  report.missing, plural(report.lost_frames, "frame"), human_bytes(peak_memory())));
  }

  std::string rig_, output_, log_path_, preset_ = "fast";
  int max_primitives_ = 0;
  double fps_ = 0, duration_ = 0;
  encoder::PrepareSettings prepare_;
  encoder::LiveSettings settings_;
  std::ofstream log_;
};

}  // namespace

std::unique_ptr<Command> make_live() {
  return std::make_unique<Live>();
}

}  // namespace stgs::tools
