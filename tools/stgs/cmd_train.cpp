// SPDX-License-Identifier: Apache-2.0
#include <filesystem>

#include "allow_outside.h"
#include "command.h"
#include "encode_options.h"
#include "output_path.h"
#include "parameter_options.h"
#include "printable.h"

namespace stgs::tools {
namespace {

class Train final : public Command {
 public:
  Help help() const override {
    return {
        "train", "Train a scene from a prepared capture",
        "Optimises the primitives against the training cameras and writes a lossless .stgs\n"
        "scene, the input of 'pack'. Ctrl-C stops it: it writes the checkpoint, if --checkpoint\n"
        "is given, but not the scene. The same seed gives the same scene on the same kind of CPU\n"
        "or GPU, without --max-seconds. Evaluations do not change the scene. Started by mpirun or\n"
        "srun as R processes, it uses R views per step and R times fewer steps, and only the\n"
        "first process writes; --iterations counts views, so the number of views is the same.",
        "  stgs train prepared/ -o scene.stgs --preset fast --report report/\n"
        "  stgs train prepared/ -o scene.stgs --checkpoint run.ckpt --max-seconds 600\n"
        "  stgs train prepared/ -o scene.stgs --resume run.ckpt\n"
        "  mpirun -np 2 --bind-to none stgs train prepared/ -o scene.stgs"};
  }
  Shared shared() const override { return encoder_shared("Training backend"); }
  void declare(Arguments& app) override {
    app.add_option("DIR", folder_, "Prepared capture");
    app.add_option("-o,--output", output_, "Output file (lossless .stgs)");
    options_.declare(app);
    add_allow_outside(app, allow_outside_);
    app.add_flag("--list-parameters", list_,
                 "List the hyper-parameters of the preset and the method, for --set, and exit");
  }
  Status run(Session& session) override {
    if (list_) return list(session);
    if (folder_.empty())
      return usage_error("DIR, the prepared capture, is required; usage: stgs train DIR -o OUTPUT");
    if (output_.empty())
      return usage_error("--output is required; usage: stgs train DIR -o OUTPUT");
    STGS_TRY(check_extension(output_, "train", ".stgs"));
    STGS_TRY(session.join_world());
    STGS_ASSIGN(const auto settings, options_.settings(session, paths(), ""));
    STGS_ASSIGN(const auto capture, encoder::read_prepared_capture(folder_, allow_outside_));
    if (session.is_first()) STGS_TRY(session.claim_output(output_));
    encoder::TrainReport report;
    STGS_TRY(train_to_file(capture, output_, options_.title(), options_.report(), settings, session,
                           report));
    if (!session.is_first()) return {};
    const auto bytes = static_cast<std::uint64_t>(std::filesystem::file_size(output_));
    const std::string held_out = report.held_out
                                     ? fmt::format(", held-out psnr {:.2f} dB of {} images",
                                                   report.held_out->psnr, report.held_out->images)
                                     : "";
    Json json = {{"output", output_}};
    json.update(to_json(report));
    json["bytes"] = bytes;
    json["report"] = options_.report_json();
    json["peak_memory"] = report.peak_memory;
    return session.emit(
        json,
        fmt::format("{}: {}, {}, {} in {:.1f} s, loss {:.5f}{}, peak memory "
                    "{}\n",
                    one_line(output_), plural(report.primitives, "primitive"), human_bytes(bytes),
                    report.processes > 1
                        ? fmt::format("{} by {} processes", plural(report.iterations, "view"),
                                      report.processes)
                        : plural(report.iterations, "step"),
                    report.seconds, report.final_loss, held_out, human_bytes(report.peak_memory)));
  }

 private:
  // Returns the output, and the files of the capture that must not be overwritten.
  std::vector<NamedPath> paths() const {
    std::vector<NamedPath> paths = {{"--output", output_}};
    for (const char* file : {"", "/capture.json", "/points_static.ply", "/points_dynamic.ply",
                             "/frames", "/masks", "/report", "/report/index.html"}) {
      paths.push_back({"DIR", folder_ + file});
    }
    return paths;
  }

  Status list(Session& session) const {
    Json parameters = Json::object();
    std::string text;
    for (const auto& [parameter, value] :
         encoder::hyper_parameters(options_.preset(), options_.method())) {
      parameters[parameter.name] = value;
      text += fmt::format("{:<24} {:<20} {} [{}]\n", parameter.name, value, option_help(parameter),
                          parameter.range());
    }
    return session.emit(
        {{"preset", options_.preset()}, {"method", options_.method()}, {"parameters", parameters}},
        text);
  }

  std::string folder_, output_;
  TrainOptions options_;
  bool list_ = false, allow_outside_ = false;
};

}  // namespace

std::unique_ptr<Command> make_train() {
  return std::make_unique<Train>();
}

}  // namespace stgs::tools
