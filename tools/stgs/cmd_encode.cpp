// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <optional>

#include "command.h"
#include "encode_options.h"
#include "output_path.h"

namespace stgs::tools {
namespace {

// When a file was written; none where there is no such file.
using WriteTime = std::optional<std::filesystem::file_time_type>;

WriteTime write_time(const std::string& path) {
  std::error_code error;
  const auto time = std::filesystem::last_write_time(path, error);
  return error ? WriteTime() : time;
}

// A checkpoint that lay there before may be of a capture that is no more.
bool was_written(const std::string& path, const WriteTime& before) {
  return write_time(path) && write_time(path) != before;
}

class Encode final : public Command {
 public:
  Help help() const override {
    return {
        "encode", "From a capture to a .stgs file: prepare, train and pack in one go",
        "Works in a temporary folder beside the output, removed at the end; --keep-work keeps\n"
        "the prepared capture and the lossless scene instead. Takes the options of the three\n"
        "verbs. Ctrl-C stops it; an output that was there before stays as it was. --checkpoint\n"
        "and --resume need --keep-work: a training goes on from the capture that is prepared\n"
        "there, which --resume does not prepare again.",
        "  stgs encode capture/ -o scene.stgs\n"
        "  stgs encode capture/ -o scene.stgs --preset fast --frames 0:60 --keep-work work/\n"
        "  stgs encode capture/ -o scene.stgs --keep-work work/ --checkpoint work/run.ckpt\n"
        "  stgs encode capture/ -o scene.stgs --keep-work work/ --resume work/run.ckpt"};
  }
  Shared shared() const override { return TrainOptions::shared(); }
  void declare(CLI::App& app) override {
    app.add_option("CAPTURE", capture_, "Folder with videos or pictures")->required();
    app.add_option("-o,--output", output_, "The .stgs file to make")->required();
    app.add_option("--keep-work", keep_work_,
                   "Folder that keeps prepared/ and trained.stgs afterwards, for --resume too");
    prepare_.declare(app);
    train_.declare(app);
    pack_.declare(app);
  }

  Status run(Session& session) override {
    if (const encoder::Launch launch = encoder::detect_launch(); launch.size > 1) {
      return usage_error(
          "{} has started {} processes, and encode runs as one: run 'stgs prepare', then 'stgs "
          "train' with them, then 'stgs pack'",
          launch.launcher, launch.size);
    }
    const auto kept = [this](const char* name) {
      return NamedPath{"--keep-work", keep_work_.empty() ? "" : keep_work_ + name};
    };
    STGS_ASSIGN(
        const auto training,
        train_.settings(session, {{"--output", output_}, kept("/prepared"), kept("/trained.stgs")},
                        keep_work_));
    STGS_TRY(check_going_on(training));
    STGS_TRY(check_can_write(output_));
    STGS_TRY(check_profile(pack_.settings().profile));
    STGS_TRY(encoder::check_up_and_floor(pack_.settings()));
    // Before the long prepare; again when it knows how large the pictures are.
    STGS_TRY(encoder::check_training(training, nullptr));
    if (!training.resume.empty()) STGS_TRY(check_kept());
    for (const std::string& folder : remove_stale_work(output_)) {
      session.log(2, fmt::format("{}: removed, a killed encode had left it", folder));
    }
    const std::string work = keep_work_.empty() ? work_name(output_) : keep_work_;
    std::error_code error;
    std::filesystem::create_directories(work, error);
    if (error) return io_error("{}: cannot create: {}", work, error.message());
    RemovedPath removed(keep_work_.empty() ? work : "");
    const std::string prepared = work + "/prepared", trained = work + "/trained.stgs";
    encoder::TrainReport train_report;
    encoder::PackReport pack_report;
    double seconds[3] = {};
    double begin = now_seconds();
    const auto lap = [&begin] {
      const double then = std::exchange(begin, now_seconds());
      return begin - then;
    };
    STGS_TRY(prepare_or_go_on(prepared, training, session));
    seconds[0] = lap();
    STGS_ASSIGN(const auto capture, encoder::read_prepared_capture(prepared));
    const WriteTime checkpoint_before = write_time(training.checkpoint);
    STGS_TRY(told_how_to_go_on(
        train_to_file(capture, trained, train_.report(), training, session, train_report), training,
        checkpoint_before));
    seconds[1] = lap();
    encoder::PackSettings packing = pack_.settings();
    const bool held_out = std::any_of(capture.cameras.begin(), capture.cameras.end(),
                                      [](const encoder::Camera& camera) { return camera.test; });
    if (held_out) packing.against = prepared;
    STGS_TRY(encoder::pack({trained}, output_, packing, &pack_report, session.progress_sink(),
                           session.log_sink()));
    seconds[2] = lap();
    return report(session, train_report, pack_report, seconds);
  }

 private:
  // kUsage where a training could not go on: its capture, prepared again, is another.
  Status check_going_on(const encoder::TrainSettings& training) const {
    if (training.resume.empty() && training.checkpoint.empty()) return {};
    if (keep_work_.empty()) {
      return usage_error(
          "{} needs the prepared capture that a training goes on from: add --keep-work FOLDER, "
          "which keeps it",
          training.resume.empty() ? "--checkpoint" : "--resume");
    }
    if (training.resume.empty() || !prepare_.overwrites()) return {};
    return usage_error(
        "--resume goes on from {}/prepared, and --overwrite replaces it; leave one out",
        keep_work_);
  }

  Status check_kept() const {
    const std::string prepared = keep_work_ + "/prepared";
    if (std::filesystem::exists(prepared)) return {};
    return io_error(
        "{}: is missing: --resume goes on from the capture that was prepared there; give the "
        "--keep-work of the run that wrote the checkpoint",
        prepared);
  }

  Status prepare_or_go_on(const std::string& prepared, const encoder::TrainSettings& training,
                          Session& session) const {
    const auto fits = [&training](const encoder::PreparedCapture& capture) {
      return encoder::check_training(training, &capture);
    };
    if (training.resume.empty()) return prepare_stage(capture_, prepared, prepare_, session, fits);
    STGS_ASSIGN(const auto capture, encoder::read_prepared_capture(prepared));
    session.log(2,
                fmt::format("{}: goes on from it; {} is not prepared again", prepared, capture_));
    return fits(capture);
  }

  // What became of the training, with the command that goes on where it was stopped.
  Status told_how_to_go_on(const Status& trained, const encoder::TrainSettings& training,
                           const WriteTime& checkpoint_before) const {
    const bool stopped = trained.code() == StatusCode::kRuntime && interrupted();
    if (!stopped || !was_written(training.checkpoint, checkpoint_before)) return trained;
    return runtime_error("{}: stopped while training; go on by the same command with --resume {}{}",
                         output_, training.checkpoint,
                         prepare_.overwrites() ? " in place of --overwrite" : "");
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
        {"report", train_.report_json()},
        {"work", keep_work_.empty() ? Json(nullptr) : Json(keep_work_)},
        {"peak_memory", peak_memory()}};
    return session.emit(
        json,
        fmt::format("{}: {} primitives ({} never visible left out), {}, {:.1f} bytes a primitive\n"
                    "{}prepare {:.1f} s, train {:.1f} s ({} steps), pack {:.1f} s, peak memory "
                    "{}\n",
                    output_, pack.primitives, pack.dropped, human_bytes(pack.bytes_out),
                    pack.bytes_per_primitive, loss_text(pack), seconds[0], seconds[1],
                    train.iterations, seconds[2], human_bytes(peak_memory())));
  }

  std::string capture_, output_, keep_work_;
  PrepareOptions prepare_;
  TrainOptions train_;
  PackOptions pack_;
};

}  // namespace

std::unique_ptr<Command> make_encode() {
  return std::make_unique<Encode>();
}

}  // namespace stgs::tools
