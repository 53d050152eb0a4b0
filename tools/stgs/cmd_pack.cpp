// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <filesystem>

#include "allow_outside.h"
#include "command.h"
#include "encode_options.h"
#include "end_after_signal.h"
#include "memory_option.h"
#include "output_path.h"
#include "printable.h"
#include "scene_input.h"

namespace stgs::tools {
namespace {

class Pack final : public Command {
 public:
  Help help() const override {
    return {
        "pack", "Compress a trained scene",
        "Writes the quantised profile: lifespan segments, bounded errors, one stream per\n"
        "attribute; or, for archives, the profile near-lossless. The file states the errors that\n"
        "'stgs info --segments' prints. Decodes the result and reports its cost: the errors of\n"
        "the primitives, the PSNR of 8 renders from and around the start camera against those of\n"
        "SCENE, and with --against the PSNR that the test cameras lose (8 images). Warns if SCENE\n"
        "was packed before.",
        "  stgs pack trained.stgs -o scene.stgs\n"
        "  stgs pack trained.stgs -o small.stgs --quality 60 --against prepared/\n"
        "  stgs pack trained.stgs -o stream.stgs --target-kbps 8000\n"
        "  stgs pack trained.stgs -o archive.stgs --profile near-lossless"};
  }
  Shared shared() const override { return {.progress = true, .log_level = true, .threads = true}; }
  void declare(Arguments& app) override {
    app.add_option("SCENE", input_, "A lossless .stgs file")->required();
    app.add_option("-o,--output", output_, "Output file (.stgs)")->required();
    auto* against = app.add_option("--against", against_,
                                   "Prepared capture: also measure the PSNR of its test cameras");
    add_allow_outside(app, allow_outside_);
    app.add_flag(
           "--foreground", foreground_,
           "--against compares with the content inside the masks, for scenes of train --foreground")
        ->needs(against);
    options_.declare(app);
    memory_.declare(app);
  }
  Status run(Session& session) override {
    STGS_TRY(check_extension(output_, "pack", ".stgs"));
    STGS_TRY(session.claim_output(output_));
    const EndAfterSignal end(session, output_ + ": not written");
    STGS_TRY(check_is_path(input_));
    STGS_TRY(check_is_scene(session, input_, memory_.limits()));
    std::error_code missing;  // an output that does not exist is a different file
    if (std::filesystem::equivalent(input_, output_, missing))
      return usage_error("{}: this is the input scene itself; use another output", output_);
    encoder::PackReport report;
    const double begin = now_seconds();
    encoder::PackSettings settings = options_.settings();
    settings.against = against_;
    settings.foreground = foreground_;
    settings.allow_outside = allow_outside_;
    settings.limits = memory_.limits();
    STGS_TRY(encoder::pack(input_, output_, settings, &report, session.progress_sink(),
                           session.log_sink()));
    Json json = {{"input", input_}, {"output", output_}, {"seconds", now_seconds() - begin}};
    json.update(to_json(report));
    json["peak_memory"] = peak_memory();
    return session.emit(
        json,
        fmt::format(
            "{}: {} ({} never visible dropped), {} to {}, {:.1f} bytes per primitive\n"
            "{}errors: position {:.3g} max, {:.3g} rms; colour {:.3g} rms; opacity {:.3g} max, "
            "{:.3g} "
            "at a frame; time {:.3g} and radius {:.3g} frames, sigma {:.3g} % max\n",
            one_line(output_), plural(report.primitives, "primitive"), report.dropped,
            human_bytes(report.bytes_in), human_bytes(report.bytes_out), report.bytes_per_primitive,
            quality_text(report), report.position_max, report.position_rms, report.colour_rms,
            report.opacity_max, report.visibility_max, report.time_max, report.radius_max,
            100.0 * std::expm1(report.sigma_max)));
  }

 private:
  std::string input_, output_, against_;
  bool allow_outside_ = false, foreground_ = false;
  PackOptions options_;
  MemoryOption memory_;
};

}  // namespace

std::unique_ptr<Command> make_pack() {
  return std::make_unique<Pack>();
}

}  // namespace stgs::tools
