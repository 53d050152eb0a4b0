// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <filesystem>

#include "command.h"
#include "losses.h"
#include "output_path.h"
#include "place.h"
#include "stgs/format/scene_recorder.h"

namespace stgs::tools {
namespace {

class Finalize final : public Command {
 public:
  Help help() const override {
    return {"finalize", "Give a live recording its index at the front",
            "Copies a file that was recorded live, also one that was cut off, to a file that a\n"
            "player opens with one read. Every record keeps its bytes, also one that is damaged,\n"
            "which readers pass over. What is damaged is told on standard error, and what is left\n"
            "out: what follows the last complete fragment, or only a damaged one lists.\n"
            "A finished file whose head is damaged gets it back from its copy.",
            "  stgs finalize live.stgs -o scene.stgs"};
  }
  Shared shared() const override { return {.log_level = true}; }
  void declare(CLI::App& app) override {
    app.add_option("FILE", input_, "The recording, a .stgs file")->required();
    app.add_option("-o,--output", output_, "The .stgs file to make")->required();
  }
  Status run(Session& session) override {
    STGS_TRY(check_is_path(input_));
    STGS_TRY(check_can_write(output_));
    std::error_code missing;  // where there is none yet, it is another file
    if (std::filesystem::equivalent(input_, output_, missing)) {
      return usage_error("{}: is the recording itself; name another output", output_);
    }
    STGS_ASSIGN(const auto recording, SceneReader::open(input_));
    STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(input_));
    DamageReport losses;
    STGS_TRY(finalize_scene(std::move(source), output_, losses));
    STGS_ASSIGN(const auto finished, SceneReader::open(output_));
    tell_losses(session, input_, losses, finished->metadata().time_base);
    const bool closed = recording->form() != SceneForm::kGrowing;
    const Json json = {{"input", input_},
                       {"output", output_},
                       {"closed", closed},
                       {"frames", finished->metadata().frames},
                       {"primitives", finished->primitives()},
                       {"parts", finished->parts().size()},
                       {"bytes_in", recording->file_bytes() + recording->incomplete_bytes()},
                       {"bytes_out", finished->file_bytes()},
                       {"incomplete_bytes", losses.incomplete_bytes},
                       {"damaged", losses_json(losses)}};
    std::string text = fmt::format("{}: {} frames, {} primitives in {} parts, {}\n", output_,
                                   finished->metadata().frames, finished->primitives(),
                                   finished->parts().size(), human_bytes(finished->file_bytes()));
    if (!closed) text += "the recording was not closed\n";
    return session.emit(json, text);
  }

 private:
  std::string input_, output_;
};

}  // namespace

std::unique_ptr<Command> make_finalize() {
  return std::make_unique<Finalize>();
}

}  // namespace stgs::tools
