// SPDX-License-Identifier: Apache-2.0
#include <filesystem>

#include "command.h"
#include "damage.h"
#include "end_after_signal.h"
#include "memory_option.h"
#include "output_path.h"
#include "printable.h"
#include "scene_input.h"
#include "stgs/format/scene_recorder.h"

namespace stgs::tools {
namespace {

class Finalize final : public Command {
 public:
  Help help() const override {
    return {
        "finalize", "Move the index of a live recording to the front",
        "Copies a live recording, complete or cut off, to a file that a player opens with one\n"
        "read. Copies every record unchanged, including damaged ones, which readers skip. Warns\n"
        "on standard error of damage and of dropped data: bytes after the last complete\n"
        "fragment, and fragments that only a damaged index lists.\n"
        "For a finished file with a damaged head, restores the head from its copy.",
        "  stgs finalize live.stgs -o scene.stgs"};
  }
  Shared shared() const override { return {.log_level = true}; }
  void declare(Arguments& app) override {
    app.add_option("FILE", input_, "The recording (.stgs)")->required();
    app.add_option("-o,--output", output_, "Output file (.stgs)")->required();
    memory_.declare(app);
  }
  Status run(Session& session) override {
    STGS_TRY(check_is_path(input_));
    STGS_TRY(check_extension(output_, "finalize", ".stgs"));
    STGS_TRY(session.claim_output(output_));
    const EndAfterSignal end(session, output_ + ": not written");
    std::error_code missing;  // an output that does not exist is a different file
    if (std::filesystem::equivalent(input_, output_, missing)) {
      return usage_error("{}: this is the recording itself; use another output", output_);
    }
    STGS_ASSIGN(const auto recording, open_scene(session, input_, memory_.limits()));
    STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(input_));
    DamageReport damage;
    STGS_TRY(finalize_scene(std::move(source), output_, damage, memory_.limits()));
    STGS_ASSIGN(const auto finished, SceneReader::open(output_, memory_.limits()));
    warn_of_damage(session, input_, damage, finished->metadata().time_base);
    const bool closed = recording->form() != SceneForm::kGrowing;
    const Json json = {{"input", input_},
                       {"output", output_},
                       {"closed", closed},
                       {"frames", finished->metadata().frames},
                       {"primitives", finished->primitives()},
                       {"parts", finished->parts().size()},
                       {"bytes_in", recording->file_bytes() + recording->incomplete_bytes()},
                       {"bytes_out", finished->file_bytes()},
                       {"incomplete_bytes", damage.incomplete_bytes},
                       {"damaged", damage_json(damage)}};
    std::string text = fmt::format(
        "{}: {}, {} in {}, {}\n", one_line(output_), plural(finished->metadata().frames, "frame"),
        plural(finished->primitives(), "primitive"), plural(std::ssize(finished->parts()), "part"),
        human_bytes(finished->file_bytes()));
    if (!closed) text += "the recording was not closed\n";
    return session.emit(json, text);
  }

 private:
  std::string input_, output_;
  MemoryOption memory_;
};

}  // namespace

std::unique_ptr<Command> make_finalize() {
  return std::make_unique<Finalize>();
}

}  // namespace stgs::tools
