// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "command.h"
#include "damage.h"
#include "end_after_signal.h"
#include "import_options.h"
#include "memory_option.h"
#include "options.h"
#include "output_path.h"
#include "printable.h"
#include "scene_input.h"
#include "stgs/format/output_file.h"

namespace stgs::tools {
namespace {

constexpr const char* kOwnName = "STGS";

// The input of a conversion, and its intermediate results.
struct Conversion {
  const InterchangeFormat* from = nullptr;  // null: .stgs
  const InterchangeFormat* to = nullptr;    // null: .stgs
  Scene scene;
  std::uint64_t bytes_in = 0, primitives_in = 0;
  std::optional<double> seconds;  // the converted time; none: all of the clip
  ImportReport report;            // later steps append their notes to report.notes
  std::optional<ConversionErrors> errors;
  DamageReport damage;              // of a .stgs file
  std::vector<std::string> extras;  // data of a .stgs file besides its scene, not converted
};

const char* name_of(const InterchangeFormat* format) {
  return format == nullptr ? kOwnName : format->name;
}

std::uint64_t bytes_at(const std::string& path) {
  std::error_code error;  // unreadable entries count as 0 bytes
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

// Returns the extensions of the formats that can be written, for messages.
std::string output_extensions() {
  std::string text = ".stgs";
  for (const InterchangeFormat& format : interchange_formats()) {
    if (format.is_writable()) text += fmt::format(", {}", format.extension);
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

// `timed`: the output has lifespans.
std::string to_text(const ConversionErrors& e, bool timed) {
  std::string text = fmt::format(
      "errors: position {:.3g} max, {:.3g} rms; log scale {:.3g} max; rotation {:.3g} degrees max; "
      "opacity {:.3g} max; colour {:.3g} max, {:.3g} rms; SH {:.3g} max, {:.3g} rms",
      e.position_max, e.position_rms, e.log_scale_max, e.rotation_max, e.opacity_max, e.colour_max,
      e.colour_rms, e.sh_max, e.sh_rms);
  if (timed) {
    text += fmt::format(
        "; opacity at a frame {:.3g}, time {:.3g} and radius {:.3g} frames, sigma {:.3g} % max",
        e.visibility_max, e.time_max, e.radius_max, 100.0 * std::expm1(e.sigma_max));
  }
  return text + "\n";
}

// Lists the primitives of a scene in another order, and the parts accordingly, possibly one for
// each primitive.
void reorder(Scene& scene, const std::vector<std::uint32_t>& order) {
  std::vector<std::uint32_t> part_of;
  for (std::uint32_t p = 0; p < scene.parts.size(); ++p) {
    part_of.insert(part_of.end(), scene.parts[p].primitives, p);
  }
  scene.gaussians = scene.gaussians.gather(order);
  if (part_of.empty()) return;
  std::vector<ScenePart> runs;
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (i == 0 || part_of[order[i]] != part_of[order[i - 1]]) {
      runs.push_back(scene.parts[part_of[order[i]]]);
      runs.back().primitives = 0;
      if (runs.back().end_ticks < scene.metadata.frames) runs.back().end_ticks -= 0x1p-20;
    }
    ++runs.back().primitives;
  }
  scene.parts = std::move(runs);
}

// Makes times count from the beginning of the parts instead of the timeline.
void to_times_of_parts(Scene& scene) {
  std::size_t i = 0;
  for (const ScenePart& part : scene.parts) {
    for (const std::size_t last = i + part.primitives; i < last && i < scene.gaussians.size();
         ++i) {
      scene.gaussians.time[i] -= static_cast<float>(part.begin_ticks);
    }
  }
}

class Convert final : public Command {
 public:
  Help help() const override {
    return {
        "convert", "Convert from and to other Gaussian-splat formats",
        "Reads .stgs (also of format 1.x), .4dgs, 3DGS PLY (also PlayCanvas packed PLY), SPZ 2\n"
        "to 4, SOG 2 (a bundle or a folder of models), .sogst, .tsog, .ftgs.ply, .splatv, and a\n"
        "folder of PLY frames; the content selects the format. Splats that are static or move\n"
        "linearly over the frames become one primitive; curved paths of a .sogst become several.\n"
        "Writes, by the extension of OUT, .stgs, .4dgs, USD as text (.usda), or a single time as\n"
        ".ply, .spz (version 4) or .glb (glTF with KHR_gaussian_splatting). Converts the axes to\n"
        "those of the target. Reads the output back, except .glb and .usda, and reports the\n"
        "errors. Warns on standard error of data that is lost.",
        "  stgs convert scene.stgs frame.ply --time 1.5\n"
        "  stgs convert scene.stgs frame.spz --time 1.5\n"
        "  stgs convert scene.stgs scene.usda\n"
        "  stgs convert splats.ply splats.stgs --quality 85\n"
        "  stgs convert frames/ clip.stgs --fps 30\n"
        "  stgs convert clip.4dgs clip.stgs --quality 85"};
  }
  Shared shared() const override { return {.log_level = true, .threads = true}; }
  void declare(Arguments& app) override {
    app.add_option("IN", input_, "Input file or folder")->required();
    app.add_option("OUT", output_, "Output file; its extension selects the format")->required();
    app.add_option("--time", seconds_,
                   "Time to convert, seconds; required if IN has several frames and OUT holds one")
        ->check(number_between(0, 1e9));
    app.add_option("--quality", quality_,
                   "For .stgs: 0 (smallest file) to 100 (closest) (default: lossless)")
        ->check(number_between(0, 100));
    app.add_option("--title", title_, "For .stgs: title of the scene (default: that of IN)");
    import_.declare(app);
    memory_.declare(app);
  }

  Status run(Session& session) override {
    const double begin = now_seconds();
    Conversion work;
    STGS_TRY(check_is_path(input_));
    STGS_TRY(check_paths(session, work));
    std::optional<EndAfterSignal> end(std::in_place, session, output_ + ": not written");
    STGS_TRY(read(session, work));
    warn_of_damage(session, input_, work.damage, work.scene.metadata.time_base);
    for (const std::string& extra : work.extras) {
      session.log(1, fmt::format("{}: not converted: {}", input_, extra));
    }
    if (title_) work.scene.metadata.title = *title_;
    STGS_TRY(select_time(work));
    STGS_ASSIGN(const std::vector<std::uint8_t> bytes, encode(session, work));
    STGS_TRY(read_back(bytes, work));
    end.reset();
    if (interrupted()) return runtime_error("{}: not written", output_);
    STGS_TRY(write_file_atomically(output_, bytes));
    for (const std::string& line : work.report.notes) {
      session.log(1, fmt::format("{}: {}", output_, line));
    }
    return report(session, work, bytes.size(), now_seconds() - begin);
  }

 private:
  Status check_paths(Session& session, Conversion& work) const {
    work.to = format_for_output(output_);
    if (work.to == nullptr && file_extension(output_) != ".stgs") {
      return usage_error("{}: unknown output format; expected a name that ends in {}", output_,
                         output_extensions());
    }
    if (work.to != nullptr && quality_) {
      return usage_error("--quality applies to .stgs output, not to {}", work.to->name);
    }
    if (work.to != nullptr && title_) {
      return usage_error("--title applies to .stgs output, not to {}", work.to->name);
    }
    STGS_TRY(check_distinct({{"IN", input_}, {"OUT", output_}}));
    return session.claim_output(output_);
  }

  Status read(Session& session, Conversion& work) const {
    STGS_ASSIGN(work.from, detect_format(input_, limits()));
    STGS_TRY(import_.check(input_, work.from));
    if (work.from == nullptr) {
      std::error_code error;
      if (std::filesystem::is_directory(input_, error)) {
        return invalid_file(
            "{}: this folder has neither PLY frames (00000.ply, 00001.ply, ...) nor a SOG, .sogst "
            "or .tsog model",
            input_);
      }
      auto opened = open_scene(session, input_, limits());
      if (!opened.ok()) return with_readable_formats(opened.status());
      const std::unique_ptr<SceneReader> reader = std::move(*opened);
      if (work.to == nullptr && reader->profile() != Profile::kLossless) {
        work.report.notes.push_back("the input was packed before: its quantisation errors remain");
      }
      STGS_ASSIGN(work.scene, recover_scene(input_, work.damage, limits()));
      STGS_ASSIGN(work.extras, scene_extras(input_, limits()));
    } else {
      STGS_ASSIGN(work.scene,
                  read_interchange(*work.from, input_, import_.settings(), limits(), work.report));
    }
    work.bytes_in = bytes_at(input_);
    work.primitives_in = work.scene.gaussians.size();
    return {};
  }

  // Reduces the scene to one time if --time is given or the target holds only one.
  Status select_time(Conversion& work) const {
    const SceneMetadata& metadata = work.scene.metadata;
    if (!seconds_ && (work.to == nullptr || work.to->write_scene != nullptr)) return {};
    if (!seconds_ && metadata.frames > 1) {
      return usage_error("{}: lasts {:.6g} s, but {} holds a single time; select one with --time",
                         input_, metadata.time_base.seconds(metadata.frames), work.to->name);
    }
    work.seconds = seconds_.value_or(0.0);
    const double end = metadata.time_base.seconds(metadata.frames);
    if (!(*work.seconds >= 0.0 && *work.seconds <= end)) {
      return usage_error("--time {} is out of range; {} lasts from 0 to {:.6g} s", *work.seconds,
                         input_, end);
    }
    const bool is_static = !moves_or_fades(work.scene);
    const double ticks = metadata.time_base.ticks(*work.seconds);
    STGS_ASSIGN(Gaussians4D set, snapshot_at(work.scene, ticks));
    note_lost_data(work, set.size(), is_static);
    Scene snapshot = static_scene(std::move(set));
    const std::uint32_t frames = snapshot.metadata.frames;
    snapshot.metadata = metadata;
    snapshot.metadata.frames = frames;
    snapshot.metadata.window.reset();
    work.scene = std::move(snapshot);
    return {};
  }

  // Adds a note for data that a single time, or the target format, cannot hold.
  void note_lost_data(Conversion& work, std::size_t visible, bool is_static) const {
    if (!is_static) {
      work.report.notes.push_back(
          fmt::format("holds {:.6g} s only, without motion and lifespans", *work.seconds));
    }
    if (visible < work.primitives_in) {
      work.report.notes.push_back(fmt::format(
          "{} of {} primitives are dropped: not visible at that time (opacity below 1/255)",
          work.primitives_in - visible, work.primitives_in));
    }
    if (work.to == nullptr || work.to->write_scene != nullptr) return;  // adds its own notes
    const std::string lost = list_metadata(work.scene.metadata, "the start camera", true);
    if (!lost.empty())
      work.report.notes.push_back(fmt::format("{} cannot hold {}", work.to->name, lost));
  }

  Result<std::vector<std::uint8_t>> encode(Session& session, Conversion& work) const {
    if (work.to != nullptr) {
      std::vector<std::uint32_t> order;
      Result<std::vector<std::uint8_t>> bytes =
          work.to->write_scene != nullptr
              ? work.to->write_scene(work.scene, limits(), &work.report.notes, &order)
              : work.to->write(work.scene.gaussians, work.scene.metadata.kernel,
                               &work.report.notes);
      if (!bytes.ok()) return write_error(bytes.status(), input_, output_);
      if (work.to->read_back != nullptr) reorder(work.scene, order);
      return bytes;
    }
    if (work.from != nullptr) work.scene.metadata.generator = "stgs " STGS_VERSION;
    WriteSettings settings;
    settings.profile = quality_ ? Profile::kQuantised : Profile::kLossless;
    settings.quality = quality_.value_or(settings.quality);
    settings.stop = session.stop_token();
    std::vector<std::uint32_t> order;
    Result<std::vector<std::uint8_t>> bytes = encode_scene(work.scene, settings, &order);
    if (!bytes.ok()) return write_error(bytes.status(), input_, output_);
    if (order.size() < work.scene.gaussians.size()) {
      work.report.notes.push_back(
          fmt::format("{} dropped: never visible",
                      plural(work.scene.gaussians.size() - order.size(), "primitive")));
    }
    // In file order, for the comparison with the decoded output.
    work.scene.gaussians = work.scene.gaussians.gather(order);
    return bytes;
  }

  // Decodes the output before it is published, if the format can be read, and measures its errors.
  Status read_back(const std::vector<std::uint8_t>& bytes, Conversion& work) const {
    if (work.to != nullptr && work.to->read == nullptr && work.to->read_back == nullptr) return {};
    Scene decoded;
    if (work.to == nullptr) {
      STGS_ASSIGN(decoded, read_scene(memory_source(bytes, output_), limits()));
    } else if (work.to->read_back != nullptr) {
      STGS_ASSIGN(decoded, work.to->read_back(*memory_source(bytes, output_), limits()));
      decoded.parts = work.scene.parts;
      to_times_of_parts(decoded);
    } else {
      STGS_ASSIGN(decoded, work.to->read(*memory_source(bytes, output_), limits(), nullptr));
    }
    STGS_ASSIGN(work.errors, conversion_errors(work.scene.gaussians, decoded));
    note_rounding(work);
    return {};
  }

  // Notes the rounding of foreign formats. That of a packed .stgs was requested with --quality.
  static void note_rounding(Conversion& work) {
    constexpr double kExact = 1e-4;  // degrees; float error of comparing quaternions
    const ConversionErrors& e = *work.errors;
    const bool exact = e.position_max == 0 && e.log_scale_max == 0 && e.rotation_max < kExact &&
                       e.opacity_max == 0 && e.colour_max == 0 && e.sh_max == 0;
    if (work.to == nullptr || exact) return;
    work.report.notes.push_back(fmt::format(
        "{} rounds or clips: positions by up to {:.2g}, log scales by {:.2g}, rotations by {:.2g} "
        "degrees, opacities by {:.2g}, colours by {:.2g}, SH by {:.2g}",
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
                 {"notes", work.report.notes},
                 {"damaged", damage_json(work.damage)},
                 {"not_converted", work.extras},
                 {"seconds", seconds},
                 {"peak_memory", peak_memory()}};
    json.update(import_json(work.report));
    std::string text =
        fmt::format("{}: {} from {} to {}, {} to {}, {:.1f} bytes per primitive\n",
                    one_line(output_), plural(primitives, "primitive"), name_of(work.from),
                    name_of(work.to), human_bytes(work.bytes_in), human_bytes(bytes_out), each);
    text += import_text(work.report);
    text += work.errors
                ? to_text(*work.errors, work.to == nullptr || work.to->write_scene != nullptr)
                : fmt::format("errors: not measured ({} cannot be read back)\n", name_of(work.to));
    return session.emit(json, text);
  }

  ReadLimits limits() const { return memory_.limits(); }

  std::string input_, output_;
  ImportOptions import_;
  MemoryOption memory_;
  std::optional<double> seconds_;
  std::optional<double> quality_;
  std::optional<std::string> title_;
};

}  // namespace

std::unique_ptr<Command> make_convert() {
  return std::make_unique<Convert>();
}

}  // namespace stgs::tools
