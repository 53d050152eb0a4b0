// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "command.h"
#include "import_options.h"
#include "losses.h"
#include "options.h"
#include "output_path.h"
#include "place.h"
#include "stgs/format/output_file.h"

namespace stgs::tools {
namespace {

constexpr const char* kOwnName = "STGS";

// What was read, and what is to become of it.
struct Conversion {
  const InterchangeFormat* from = nullptr;  // null: .stgs
  const InterchangeFormat* to = nullptr;    // null: .stgs
  Scene scene;
  std::uint64_t bytes_in = 0, primitives_in = 0;
  std::optional<double> seconds;  // the moment that is kept; none where all are
  ImportReport found;             // its notes go on with what is lost after reading
  std::optional<ConversionErrors> errors;
  DamageReport losses;              // of a damaged .stgs file
  std::vector<std::string> extras;  // that such a file holds beside its scene
};

const char* name_of(const InterchangeFormat* format) {
  return format == nullptr ? kOwnName : format->name;
}

std::uint64_t bytes_at(const std::string& path) {
  std::error_code error;  // what cannot be looked at counts nothing
  if (!std::filesystem::is_directory(path, error)) {
    const std::uintmax_t bytes = std::filesystem::file_size(path, error);
    return error ? 0 : bytes;
  }
  std::uint64_t bytes = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(path, error)) {
    if (entry.is_regular_file(error)) bytes += entry.file_size(error);
  }
  return bytes;
}

bool moves_or_fades(const Scene& scene) {
  const Gaussians4D& set = scene.gaussians;
  if (!scene.parts.empty()) return true;
  const auto frames = static_cast<float>(scene.metadata.frames);
  if (std::any_of(set.velocity.begin(), set.velocity.end(), [](float v) { return v != 0.0f; })) {
    return true;
  }
  for (std::size_t i = 0; i < set.size(); ++i) {
    const float away = std::max(std::abs(set.time[i]), std::abs(frames - set.time[i]));
    if (away > set.radius[i]) return true;
  }
  return false;
}

// The endings of what can be written, for messages.
std::string written_endings() {
  std::string text = ".stgs";
  for (const InterchangeFormat& format : interchange_formats()) {
    if (format.write != nullptr) text += fmt::format(", {}", format.extension);
  }
  return text;
}

Json to_json(const ConversionErrors& e) {
  return {{"position_max", e.position_max},
          {"position_rms", e.position_rms},
          {"log_scale_max", e.log_scale_max},
          {"rotation_max", e.rotation_max},
          {"opacity_max", e.opacity_max},
          {"colour_max", e.colour_max},
          {"colour_rms", e.colour_rms},
          {"sh_max", e.sh_max},
          {"sh_rms", e.sh_rms},
          {"visibility_max", e.visibility_max},
          {"time_max", e.time_max},
          {"radius_max", e.radius_max},
          {"sigma_max", e.sigma_max}};
}

// `timed`: lifespans were written too.
std::string to_text(const ConversionErrors& e, bool timed) {
  std::string text = fmt::format(
      "errors: position {:.3g} at most, {:.3g} rms; log scale {:.3g} at most; rotation {:.3g} "
      "degrees at most; opacity {:.3g} at most; colour {:.3g} at most, {:.3g} rms; harmonics "
      "{:.3g} at most, {:.3g} rms",
      e.position_max, e.position_rms, e.log_scale_max, e.rotation_max, e.opacity_max, e.colour_max,
      e.colour_rms, e.sh_max, e.sh_rms);
  if (timed) {
    text += fmt::format(
        "; opacity at a frame {:.3g}, time {:.3g} and radius {:.3g} frames, sigma {:.3g} % at most",
        e.visibility_max, e.time_max, e.radius_max, 100.0 * std::expm1(e.sigma_max));
  }
  return text + "\n";
}

class Convert final : public Command {
 public:
  Help help() const override {
    return {"convert", "From and to the formats of other programs",
            "Reads .stgs, 3DGS PLY (and PlayCanvas's packed PLY), SPZ 2 to 4, SOG 2 (a bundle, or\n"
            "a folder of models), .splatv, and a folder of PLY frames, by what is there. Splats\n"
            "that stay or move straight over frames become one primitive. Writes, by the name's\n"
            "ending, .stgs, and of one moment .ply, .spz (version 4) or .glb (glTF with\n"
            "KHR_gaussian_splatting). Axes are turned to those of the target. Reads back what it\n"
            "wrote, but for .glb, which is not read here, and tells the errors; what is lost is\n"
            "told on standard error.",
            "  stgs convert scene.stgs moment.ply --time 1.5\n"
            "  stgs convert scene.stgs moment.spz --time 1.5\n"
            "  stgs convert splats.ply splats.stgs --quality 85\n"
            "  stgs convert frames/ clip.stgs --fps 30"};
  }
  Shared shared() const override { return {.log_level = true, .threads = true}; }
  void declare(CLI::App& app) override {
    app.add_option("IN", input_, "The file or folder to read")->required();
    app.add_option("OUT", output_, "The file to make; its ending says the format")->required();
    app.add_option("--time", seconds_,
                   "The moment to keep, seconds; needed where IN has several "
                   "frames and OUT holds one")
        ->check(number_between(0, 1e9));
    app.add_option("--quality", quality_,
                   "For .stgs: 0 (smallest) to 100 (nearest); without it every float is kept")
        ->check(number_between(0, 100));
    import_.declare(app);
  }

  Status run(Session& session) override {
    const double begin = now_seconds();
    Conversion work;
    STGS_TRY(check_is_path(input_));
    STGS_TRY(check_places(work));
    STGS_TRY(read(work));
    tell_losses(session, input_, work.losses, work.scene.metadata.time_base);
    for (const std::string& extra : work.extras) {
      session.log(1, fmt::format("{}: is not carried over: {}", input_, extra));
    }
    STGS_TRY(choose_moment(work));
    STGS_ASSIGN(const std::vector<std::uint8_t> bytes, encode(session, work));
    STGS_TRY(read_back(bytes, work));
    if (interrupted()) return runtime_error("{}: stopped, nothing is written", output_);
    STGS_TRY(write_file_atomically(output_, bytes));
    for (const std::string& line : work.found.notes) {
      session.log(1, fmt::format("{}: {}", output_, line));
    }
    return report(session, work, bytes.size(), now_seconds() - begin);
  }

 private:
  Status check_places(Conversion& work) const {
    work.to = format_for_output(output_);
    if (work.to == nullptr && file_extension(output_) != ".stgs") {
      return usage_error("{}: its ending names no format that is written; those are {}", output_,
                         written_endings());
    }
    if (work.to != nullptr && quality_) {
      return usage_error("--quality is for .stgs; {} has none", work.to->name);
    }
    STGS_TRY(check_can_write(output_));
    return check_distinct({{"IN", input_}, {"OUT", output_}});
  }

  Status read(Conversion& work) const {
    STGS_ASSIGN(work.from, detect_format(input_));
    STGS_TRY(import_.check(input_, work.from));
    if (work.from == nullptr) {
      std::error_code error;
      if (std::filesystem::is_directory(input_, error)) {
        return io_error(
            "{}: the folder holds neither PLY frames (00000.ply, 00001.ply, ...) "
            "nor a SOG model; name the file or folder that does",
            input_);
      }
      STGS_ASSIGN(const std::unique_ptr<SceneReader> reader, SceneReader::open(input_));
      if (work.to == nullptr && reader->profile() != Profile::kLossless) {
        work.found.notes.push_back("its scene was packed: what that lost stays lost");
      }
      STGS_ASSIGN(work.scene, recover_scene(input_, work.losses));
      STGS_ASSIGN(work.extras, scene_extras(input_));
    } else {
      STGS_ASSIGN(work.scene,
                  read_interchange(*work.from, input_, import_.settings(), {}, work.found));
    }
    work.bytes_in = bytes_at(input_);
    work.primitives_in = work.scene.gaussians.size();
    return {};
  }

  // Leaves one moment of the scene where one is asked for, or the target holds no more.
  Status choose_moment(Conversion& work) const {
    const SceneMetadata& metadata = work.scene.metadata;
    if (!seconds_ && work.to == nullptr) return {};
    if (!seconds_ && metadata.frames > 1) {
      return usage_error("{} lasts {:.6g} s, and {} holds one moment: choose it with --time",
                         input_, metadata.time_base.seconds(metadata.frames), work.to->name);
    }
    work.seconds = seconds_.value_or(0.0);
    const bool all_still = !moves_or_fades(work.scene);
    const double ticks = metadata.time_base.ticks(*work.seconds);
    STGS_ASSIGN(Gaussians4D set, snapshot_at(work.scene, ticks));
    note_losses(work, set.size(), all_still);
    Scene moment = static_scene(std::move(set));
    const std::uint32_t frames = moment.metadata.frames;
    moment.metadata = metadata;
    moment.metadata.frames = frames;
    moment.metadata.window.reset();
    work.scene = std::move(moment);
    return {};
  }

  // What a moment, and then the target, cannot hold of the scene.
  void note_losses(Conversion& work, std::size_t seen, bool all_still) const {
    if (!all_still) {
      work.found.notes.push_back(
          fmt::format("holds the moment {:.6g} s alone, without motion and "
                      "lifespans",
                      *work.seconds));
    }
    if (seen < work.primitives_in) {
      work.found.notes.push_back(
          fmt::format("{} of {} primitives are left out: they are not seen at "
                      "that moment (opacity below 1/255)",
                      work.primitives_in - seen, work.primitives_in));
    }
    if (work.to == nullptr) return;
    const SceneMetadata& m = work.scene.metadata;
    std::string lost;
    const auto lose = [&lost](const char* what) {
      lost += fmt::format("{}{}", lost.empty() ? "" : ", ", what);
    };
    if (m.start_camera) lose("the start camera");
    if (std::any_of(m.background, m.background + 3, [](float v) { return v != 0.0f; })) {
      lose("the background's colour");
    }
    if (!m.title.empty()) lose("the title");
    if (m.metres_per_unit > 0) lose("how many metres a unit is");
    if (std::any_of(m.up, m.up + 3, [](float v) { return v != 0.0f; })) {
      lose("what is up and where the floor is");
    }
    if (!m.audio.empty()) lose("where the sound is");
    if (!lost.empty())
      work.found.notes.push_back(fmt::format("{} cannot hold {}", work.to->name, lost));
  }

  Result<std::vector<std::uint8_t>> encode(Session& session, Conversion& work) const {
    if (work.to != nullptr) {
      Result<std::vector<std::uint8_t>> bytes =
          work.to->write(work.scene.gaussians, &work.found.notes);
      if (bytes.ok()) return bytes;
      return Status(bytes.status().code(),
                    fmt::format("{}: {}", output_, bytes.status().message()));
    }
    if (work.from != nullptr) work.scene.metadata.generator = "stgs " STGS_VERSION;
    WriteSettings settings;
    settings.profile = quality_ ? Profile::kQuantised : Profile::kLossless;
    settings.quality = quality_.value_or(settings.quality);
    settings.stop = session.stop_token();
    std::vector<std::uint32_t> order;
    STGS_ASSIGN(std::vector<std::uint8_t> bytes, encode_scene(work.scene, settings, &order));
    if (order.size() < work.scene.gaussians.size()) {
      work.found.notes.push_back(fmt::format("{} primitives are left out: they are never visible",
                                             work.scene.gaussians.size() - order.size()));
    }
    // In the order of the file, so that what is read back can be compared.
    work.scene.gaussians = work.scene.gaussians.gather(order);
    return bytes;
  }

  // What is published has been read once, where it can be read.
  Status read_back(const std::vector<std::uint8_t>& bytes, Conversion& work) const {
    if (work.to != nullptr && work.to->read == nullptr) return {};
    Scene got;
    if (work.to == nullptr) {
      STGS_ASSIGN(got, read_scene(memory_source(bytes, output_)));
    } else {
      STGS_ASSIGN(got, work.to->read(*memory_source(bytes, output_), {}, nullptr));
    }
    STGS_ASSIGN(work.errors, conversion_errors(work.scene.gaussians, got));
    note_rounding(work);
    return {};
  }

  // A packed .stgs was asked for with its quality; the rounding of another format was not.
  static void note_rounding(Conversion& work) {
    constexpr double kExact = 1e-4;  // degrees; what is left of comparing quaternions in floats
    const ConversionErrors& e = *work.errors;
    const bool exact = e.position_max == 0 && e.log_scale_max == 0 && e.rotation_max < kExact &&
                       e.opacity_max == 0 && e.colour_max == 0 && e.sh_max == 0;
    if (work.to == nullptr || exact) return;
    work.found.notes.push_back(fmt::format(
        "{} rounds or clips: positions by up to {:.2g}, log scales by {:.2g}, rotations by {:.2g} "
        "degrees, opacities by {:.2g}, colours by {:.2g}, harmonics by {:.2g}",
        work.to->name, e.position_max, e.log_scale_max, e.rotation_max, e.opacity_max, e.colour_max,
        e.sh_max));
  }

  Status report(Session& session, const Conversion& work, std::uint64_t bytes_out,
                double seconds) const {
    const std::size_t primitives = work.scene.gaussians.size();
    const double each =
        static_cast<double>(bytes_out) / std::max<double>(1.0, static_cast<double>(primitives));
    Json json = {{"input", input_},
                 {"input_format", name_of(work.from)},
                 {"output", output_},
                 {"output_format", name_of(work.to)},
                 {"time_s", work.seconds ? Json(*work.seconds) : Json(nullptr)},
                 {"frames", work.scene.metadata.frames},
                 {"sh_degree", work.scene.gaussians.sh_degree},
                 {"primitives_in", work.primitives_in},
                 {"primitives", primitives},
                 {"bytes_in", work.bytes_in},
                 {"bytes_out", bytes_out},
                 {"bytes_per_primitive", each},
                 {"errors", work.errors ? to_json(*work.errors) : Json(nullptr)},
                 {"notes", work.found.notes},
                 {"damaged", losses_json(work.losses)},
                 {"not_converted", work.extras},
                 {"seconds", seconds},
                 {"peak_memory", peak_memory()}};
    json.update(import_json(work.found));
    std::string text =
        fmt::format("{}: {} primitives of {} to {}, {} to {}, {:.1f} bytes a primitive\n", output_,
                    primitives, name_of(work.from), name_of(work.to), human_bytes(work.bytes_in),
                    human_bytes(bytes_out), each);
    text += import_text(work.found);
    text += work.errors
                ? to_text(*work.errors, work.to == nullptr)
                : fmt::format("errors: not measured, {} is not read here\n", name_of(work.to));
    return session.emit(json, text);
  }

  std::string input_, output_;
  ImportOptions import_;
  std::optional<double> seconds_;
  std::optional<double> quality_;
};

}  // namespace

std::unique_ptr<Command> make_convert() {
  return std::make_unique<Convert>();
}

}  // namespace stgs::tools
