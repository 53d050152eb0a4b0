// SPDX-License-Identifier: Apache-2.0
#include <fmt/ranges.h>

#include <filesystem>
#include <optional>

#include "arguments.h"
#include "command.h"
#include "encode_options.h"
#include "encode_windows.h"
#include "end_after_signal.h"
#include "opencv.h"
#include "options.h"
#include "output_path.h"
#include "printable.h"

namespace stgs::tools {
namespace {

// A CLI11 validator of --window.
std::string check_window(const std::string& text) {
  return text == "0" ? "" : number_between(encoder::kMinWindowFrames, 1e6)(text);
}

// The modification time of a file; none if it does not exist.
using WriteTime = std::optional<std::filesystem::file_time_type>;

WriteTime write_time(const std::string& path) {
  std::error_code error;
  const auto time = std::filesystem::last_write_time(path, error);
  return error ? WriteTime() : time;
}

// Returns whether the file was written since `before`. An older checkpoint may belong to a capture
// that has been replaced.
bool was_written(const std::string& path, const WriteTime& before) {
  return write_time(path) && write_time(path) != before;
}

class Encode final : public Command {
 public:
  Help help() const override {
    return {
        "encode", "Encode a capture to a .stgs file: prepare, train and pack",
        "Accepts the options of the three verbs. Works in a temporary folder next to the output\n"
        "and removes it at the end; --keep-work keeps the prepared capture and the lossless\n"
        "scene. Ctrl-C stops it and leaves an existing output unchanged. --checkpoint and\n"
        "--resume require --keep-work: training resumes on the capture prepared there, and\n"
        "--resume does not prepare it again.\n"
        "A capture of more than 300 frames, or with --window, is encoded in windows of time that\n"
        "share static content. It takes the memory of two windows, and the same command continues\n"
        "after the last complete window of an interrupted run, in the folder OUTPUT.work. Started\n"
        "by mpirun or srun as several processes, which share this folder, each trains windows of\n"
        "its own. --window 0 encodes all frames at once, which --checkpoint, --resume, --log,\n"
        "--report, --max-seconds, --num-evals, --target-kbps and --target-size need.",
        "  stgs encode capture/ -o scene.stgs\n"
        "  stgs encode capture/ -o scene.stgs --preset fast --frames 0:60 --keep-work work/\n"
        "  stgs encode capture/ -o scene.stgs --window 60\n"
        "  mpirun -np 2 --bind-to none stgs encode capture/ -o scene.stgs --window 60\n"
        "  stgs encode capture/ -o scene.stgs --keep-work work/ --checkpoint work/run.ckpt\n"
        "  stgs encode capture/ -o scene.stgs --keep-work work/ --resume work/run.ckpt"};
  }
  Shared shared() const override { return encoder_shared("Backend of preparation and training"); }
  void declare(Arguments& app) override {
    app.add_option("CAPTURE", capture_, "Folder of videos or images")->required();
    app.add_option("-o,--output", output_, "Output file (.stgs)")->required();
    app.add_option("--keep-work", keep_work_,
                   "Keep prepared/ and trained.stgs in this folder, also for --resume; in windows, "
                   "the state of the run");
    app.add_option("--window", window_,
                   "Encode windows of this many frames, at least 8, which share static content; 0: "
                   "all frames at once. Default: 2 seconds, but 8 to 300 frames, for more than 300 "
                   "frames, else 0")
        ->check(check_window);
    prepare_.declare(app);
    train_.declare(app, true);
    pack_.declare(app);
  }

  Status run(Session& session) override {
    STGS_TRY(check_extension(output_, "encode", ".stgs"));
    STGS_TRY(session.join_world());
    set_up_opencv(session.options);  // with the threads of this process
    const auto work_path = [this](const char* name) {
      return NamedPath{"--keep-work", keep_work_.empty() ? "" : keep_work_ + name};
    };
    train_.train_for(pack_.settings());
    STGS_ASSIGN(
        auto training,
        train_.settings(session,
                        {{"--output", output_}, work_path("/prepared"), work_path("/trained.stgs")},
                        keep_work_));
    training.ranks = nullptr;  // each process trains windows of its own
    if (window_ > 0 && !training.resume.empty()) {
      return usage_error(
          "--window and --resume exclude each other: an interrupted run in windows continues with "
          "the same command");
    }
    STGS_TRY(check_resumable(training));
    if (session.is_first()) STGS_TRY(session.claim_output(output_));
    STGS_TRY(encoder::check_packing(pack_.settings()));
    // Before the long prepare; again once the size of the images is known.
    STGS_TRY(encoder::check_training(training, nullptr));
    if (!training.resume.empty()) STGS_TRY(check_prepared());
    STGS_TRY(check_not_prepared(training));
    std::unique_ptr<encoder::WindowPreparer> windows;
    if (training.resume.empty()) {
      STGS_ASSIGN(windows, open_stage(capture_, window_, prepare_, session,
                                      [&training](const encoder::PreparedCapture& capture) {
                                        return encoder::check_training(training, &capture);
                                      }));
      if (windows->windows().size() > 1) return encode_all(*windows, training, session);
    }
    if (session.world() != nullptr) {
      return usage_error(
          "{}: one process encodes all frames at once, but {} have been started; encode windows "
          "(--window), or use 'stgs prepare', 'stgs train' with several processes and 'stgs pack'",
          capture_, session.world()->size());
    }
    WorkFolder folder;
    if (keep_work_.empty()) STGS_TRY(folder.create(output_));
    const std::string work = keep_work_.empty() ? folder.path() : keep_work_;
    std::error_code error;
    std::filesystem::create_directories(work, error);
    if (error) return io_error("{}: cannot create: {}", work, error.message());
    if (!keep_work_.empty()) STGS_TRY(session.claim_folder(keep_work_));
    const std::string prepared = work + "/prepared", trained = work + "/trained.stgs";
    encoder::TrainReport train_report;
    encoder::PackReport pack_report;
    double seconds[3] = {};
    double begin = now_seconds();
    const auto lap = [&begin] {
      const double then = std::exchange(begin, now_seconds());
      return begin - then;
    };
    STGS_ASSIGN(const auto capture, prepare_or_resume(windows.get(), prepared, training, session));
    seconds[0] = lap();
    const WriteTime checkpoint_before = write_time(training.checkpoint);
    STGS_TRY(with_resume_hint(train_to_file(capture, trained, train_.title(), train_.report(),
                                            training, session, train_report),
                              training, checkpoint_before));
    seconds[1] = lap();
    encoder::PackSettings packing = pack_.settings();
    packing.quality = packing.target_psnr = 0;  // the scene was trained for it
    encoder::PreparedCapture shown = capture;
    if (training.foreground) shown.mask_background = encoder::kMaskBackground;
    if (!encoder::sample_views(shown, true, encoder::kMaxHeldOutImages).empty()) {
      packing.against_capture = std::make_shared<const encoder::PreparedCapture>(capture);
      packing.foreground = training.foreground;
      packing.held_out_before = train_report.held_out;  // the latest is that of the final scene
    }
    const EndAfterSignal end(session, output_ + ": not written");
    STGS_TRY(encoder::pack(trained, output_, packing, &pack_report, session.progress_sink(),
                           session.log_sink()));
    seconds[2] = lap();
    return report(session, train_report, pack_report, seconds);
  }

 private:
  // kUsage if the training could not be resumed: a capture that is prepared again differs.
  Status check_resumable(const encoder::TrainSettings& training) const {
    if (training.resume.empty() && training.checkpoint.empty()) return {};
    if (keep_work_.empty()) {
      return usage_error(
          "{} requires --keep-work FOLDER, which keeps the prepared capture to resume from",
          training.resume.empty() ? "--checkpoint" : "--resume");
    }
    if (training.resume.empty() || !prepare_.overwrite()) return {};
    return usage_error("--resume reads {}/prepared, but --overwrite replaces it; use one of them",
                       keep_work_);
  }

  // Before the capture is read, which can take long.
  Status check_not_prepared(const encoder::TrainSettings& training) const {
    const std::string prepared = keep_work_ + "/prepared";
    if (keep_work_.empty() || window_ > 0 || !training.resume.empty() || prepare_.overwrite() ||
        !std::filesystem::exists(prepared))
      return {};
    return usage_error("{}: exists; name another folder, or replace it with --overwrite", prepared);
  }

  Status check_prepared() const {
    const std::string prepared = keep_work_ + "/prepared";
    if (std::filesystem::exists(prepared)) return {};
    return io_error(
        "{}: not found; --resume needs the --keep-work folder of the run that wrote the checkpoint",
        prepared);
  }

  // Encodes the windows of a long capture.
  Status encode_all(encoder::WindowPreparer& windows, const encoder::TrainSettings& training,
                    Session& session) const {
    const int evaluations = training.held_out_evaluations;
    const bool evaluations_are_set =
        evaluations != 0 && evaluations != encoder::TrainSettings().held_out_evaluations;
    if (!training.checkpoint.empty() || !training.log_path.empty() || !train_.report().empty() ||
        training.target_size > 0 || training.target_kbps > 0 || training.max_seconds > 0 ||
        evaluations_are_set) {
      return usage_error(
          "{}: --checkpoint, --log, --report, --max-seconds, --num-evals, --target-kbps and "
          "--target-size need "
          "all frames at once; remove them, or add --window 0 to encode {} frames at once (an "
          "interrupted run in windows resumes without a checkpoint)",
          capture_, windows.windows().back().end);
    }
    encoder::StreamSettings settings;
    settings.train = training;
    settings.pack = pack_.settings();
    // The windows are trained for these.
    settings.pack.quality = settings.pack.target_psnr = 0;
    settings.train.held_out_evaluations = 0;
    settings.title = train_.title();
    STGS_ASSIGN(settings.identity, identity_of(windows, settings));
    const std::string work = keep_work_.empty() ? output_ + ".work" : keep_work_;
    return encode_windows(windows, settings, work, !keep_work_.empty(), output_, session);
  }

  // Returns a description of all inputs of the run but the training settings.
  static Result<std::string> identity_of(const encoder::WindowPreparer& windows,
                                         const encoder::StreamSettings& settings) {
    STGS_ASSIGN(std::string text, windows.identity());
    text +=
        fmt::format("title {}\nprofile {}\n", settings.title, profile_name(settings.pack.profile));
    encoder::PackParameters::for_each([&](const Parameter& parameter, const auto& member) {
      text += fmt::format("{} {}\n", parameter.name, member(settings.pack));
    });
    for (const auto* vector : {&settings.pack.up, &settings.pack.floor}) {
      if (*vector) text += fmt::format("vector {}\n", fmt::join(**vector, " "));
    }
    return text + fmt::format("audio {}\n", settings.pack.audio.value_or(""));
  }

  Result<encoder::PreparedCapture> prepare_or_resume(encoder::WindowPreparer* windows,
                                                     const std::string& prepared,
                                                     const encoder::TrainSettings& training,
                                                     Session& session) const {
    if (windows != nullptr) {
      const EndAfterSignal end(session, prepared + ": not written");
      return windows->prepare(0, prepared, !keep_work_.empty(), session.progress_sink(),
                              session.log_sink());
    }
    STGS_ASSIGN(const auto capture, encoder::read_prepared_capture(prepared));
    session.log(2,
                fmt::format("{}: resuming from it; {} is not prepared again", prepared, capture_));
    STGS_TRY(encoder::check_training(training, &capture));
    return capture;
  }

  // Adds the command that resumes to the status of an interrupted training.
  Status with_resume_hint(const Status& trained, const encoder::TrainSettings& training,
                          const WriteTime& checkpoint_before) const {
    const bool stopped = trained.code() == StatusCode::kRuntime && interrupted();
    if (!stopped || !was_written(training.checkpoint, checkpoint_before)) return trained;
    return runtime_error(
        "{}: training is incomplete; to resume, run the same command with --resume "
        "{}{}",
        output_, training.checkpoint, prepare_.overwrite() ? " instead of --overwrite" : "");
  }

  Status report(Session& session, const encoder::TrainReport& train,
                const encoder::PackReport& pack, const double* seconds) const {
    const Json json = {
        {"output", output_},
        {"primitives", pack.primitives},
        {"bytes", pack.bytes_out},
        {"bytes_per_primitive", pack.bytes_per_primitive},
        {"seconds", {{"prepare", seconds[0]}, {"train", seconds[1]}, {"pack", seconds[2]}}},
        {"train", to_json(train)},
        {"pack", to_json(pack)},
        {"windows", Json::array()},
        {"report", train_.report_json()},
        {"work", keep_work_.empty() ? Json(nullptr) : Json(keep_work_)},
        {"peak_memory", peak_memory()}};
    return session.emit(
        json, fmt::format("{}: {} ({} never visible dropped), {}, {:.1f} bytes per primitive\n"
                          "{}prepare {:.1f} s, train {:.1f} s ({}), pack {:.1f} s, peak memory "
                          "{}\n",
                          one_line(output_), plural(pack.primitives, "primitive"), pack.dropped,
                          human_bytes(pack.bytes_out), pack.bytes_per_primitive, quality_text(pack),
                          seconds[0], seconds[1], plural(train.iterations, "step"), seconds[2],
                          human_bytes(peak_memory())));
  }

  std::string capture_, output_, keep_work_;
  int window_ = encoder::kDefaultWindow;  // 0: all frames at once
  PrepareOptions prepare_;
  TrainOptions train_;
  PackOptions pack_;
};

}  // namespace

std::unique_ptr<Command> make_encode() {
  return std::make_unique<Encode>();
}

}  // namespace stgs::tools
