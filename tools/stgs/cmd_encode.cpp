// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>

#include "command.h"
#include "encode_options.h"
#include "output_place.h"

namespace stgs::tools {
namespace {

class Encode final : public Command {
 public:
  Help help() const override {
    return {"encode", "From a capture to a .stgs file: prepare, train and pack in one go",
            "Works in a temporary folder beside the output, removed at the end; --keep-work keeps\n"
            "the prepared capture and the lossless scene instead. Takes the options of the three\n"
            "verbs. Ctrl-C stops it; an output that was there before stays as it was.",
            "  stgs encode capture/ -o scene.stgs\n"
            "  stgs encode capture/ -o scene.stgs --preset fast --frames 0:60 --keep-work work/"};
  }
  Shared shared() const override { return TrainOptions::shared(); }
  void declare(CLI::App& app) override {
    app.add_option("CAPTURE", capture_, "Folder with videos or pictures")->required();
    app.add_option("-o,--output", output_, "The .stgs file to make")->required();
    app.add_option("--keep-work", keep_work_,
                   "Folder that keeps prepared/ and trained.stgs afterwards");
    prepare_.declare(app);
    train_.declare(app);
    pack_.declare(app);
  }

  Status run(Session& session) override {
    if (const encoder::Launch launch = encoder::launch_of_environment(); launch.size > 1) {
      return usage_error(
          "{} has started {} processes, and encode runs as one: run 'stgs prepare', then 'stgs "
          "train' with them, then 'stgs pack'",
          launch.starter, launch.size);
    }
    const auto kept = [this](const char* name) {
      return NamedPlace{"--keep-work", keep_work_.empty() ? "" : keep_work_ + name};
    };
    STGS_ASSIGN(
        const auto training,
        train_.settings(session, {{"--output", output_}, kept("/prepared"), kept("/trained.stgs")},
                        keep_work_));
    STGS_TRY(check_can_write(output_));
    STGS_TRY(check_profile(pack_.settings().profile));
    // Before the long prepare; again when it knows how large the pictures are.
    STGS_TRY(encoder::check_training(training, nullptr));
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
    STGS_TRY(prepare_stage(capture_, prepared, prepare_, session,
                           [&training](const encoder::PreparedCapture& capture) {
                             return encoder::check_training(training, &capture);
                           }));
    seconds[0] = lap();
    STGS_ASSIGN(const auto capture, encoder::read_prepared_capture(prepared));
    STGS_TRY(train_to_file(capture, trained, train_.report(), training, session, train_report));
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
