// SPDX-License-Identifier: Apache-2.0
#include "command.h"
#include "encode_options.h"
#include "output_path.h"
#include "printable.h"
#include "stgs/encoder/prepared_capture.h"

namespace stgs::tools {
namespace {

class Prepare final : public Command {
 public:
  Help help() const override {
    return {"prepare", "Prepare a capture for training, from videos or images",
            "Reads cameras and frames of a common dataset layout; undistorts, detects motion and\n"
            "computes initial points. Videos (layout 'videos') are calibrated by a file next to\n"
            "them: cameras.json, or the calibration of Pose2Sim, Anipose, Qualisys or OpenCV;\n"
            "without one, by COLMAP. The result is a folder that 'train' and 'evaluate' read.\n"
            "Inspect its report/index.html before training.",
            "  stgs prepare capture/ -o prepared/\n"
            "  stgs prepare capture/ -o prepared/ --frames 0:60 --scale 0.5 --test-cameras cam00"};
  }
  Shared shared() const override {
    return encoder_shared("Backend of frames, stereo, sweeps, motion and velocities");
  }
  void declare(Arguments& app) override {
    app.add_option("CAPTURE", capture_, "Folder of videos or images")->required();
    app.add_option("-o,--output", output_, "Output folder")->required();
    options_.declare(app);
  }
  Status run(Session& session) override {
    const double begin = now_seconds();
    STGS_TRY(check_extension(output_, "prepare", ""));
    STGS_TRY(prepare_stage(capture_, output_, options_, session));
    STGS_ASSIGN(const auto prepared, encoder::read_prepared_capture(output_));
    const auto test = std::count_if(prepared.cameras.begin(), prepared.cameras.end(),
                                    [](const encoder::Camera& c) { return c.test; });
    const double seconds = now_seconds() - begin;
    const Json json = {{"output", output_},
                       {"source", prepared.source},
                       {"cameras", prepared.cameras.size()},
                       {"test_cameras", test},
                       {"frames", prepared.frames},
                       {"fps", 1.0 / prepared.time_base.seconds(1)},
                       {"seconds", seconds},
                       {"peak_memory", peak_memory()}};
    return session.emit(
        json,
        fmt::format("{}: {} ({} held out), {} at {:.6g} fps, from {}, {:.1f} s, peak memory {}\n",
                    one_line(output_), plural(std::ssize(prepared.cameras), "camera"), test,
                    plural(prepared.frames, "frame"), 1.0 / prepared.time_base.seconds(1),
                    prepared.source, seconds, human_bytes(peak_memory())));
  }

 private:
  std::string capture_, output_;
  PrepareOptions options_;
};

}  // namespace

std::unique_ptr<Command> make_prepare() {
  return std::make_unique<Prepare>();
}

}  // namespace stgs::tools
