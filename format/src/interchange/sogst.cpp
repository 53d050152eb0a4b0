// SPDX-License-Identifier: Apache-2.0
// Reading .sogst version 1, as specified by Solipsist Studios ("The .sogst format - SOG +
// spacetime", revision 5): a SOG bundle with velocities, accelerations and lifespans. The streamed
// layout has a set of images for each group of splats.
#include <algorithm>
#include <cfloat>
#include <cmath>
#include <numbers>

#include "interchange/curves.h"
#include "interchange/import.h"
#include "interchange/json_fields.h"
#include "interchange/sog_decoder.h"

namespace stgs {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxSegments = 65536;

// Splats with images of their own.
struct Group {
  std::string folder;  // "" or "name/"
  std::size_t count = 0;
};

// Bytes of a group and its entry in a sorted list.
constexpr std::uint64_t kGroupMemory = sizeof(Group) + 2 * sizeof(std::string_view);

struct SogstMeta {
  SogLayout layout;
  SogRange motion;
  std::optional<SogRange> acceleration;
  Codebook centres, deviations;  // seconds
  std::string lifespans_file;
  double begin = 0, end = 0, fps = 0;  // seconds, Hz
  std::array<double, 2> footprint = {1, 1};
  std::vector<Group> groups;    // in the order of the splats
  std::uint64_t in_groups = 0;  // splats
  Lease lease;                  // of the groups
};

Status parse_sogst_time(const json& time, const std::string& label, SogstMeta& meta) {
  STGS_ASSIGN(meta.begin, sog_number(member(time, "min"), label + ": time.min"));
  STGS_ASSIGN(meta.end, sog_number(member(time, "max"), label + ": time.max"));
  STGS_ASSIGN(meta.fps, sog_number(member(time, "fps"), label + ": time.fps"));
  if (!(meta.end >= meta.begin)) {
    return invalid_file("{}: time.max {} is before time.min {}", label, meta.end, meta.begin);
  }
  if (!(meta.fps >= 0.001 && meta.fps <= 1e6)) {
    return invalid_file("{}: time.fps: expected 0.001 to 1000000, got {}", label, meta.fps);
  }
  if ((meta.end - meta.begin) * meta.fps > 0xFFFFFFFE) {
    return unsupported("{}: a clip of {} s at {} fps has too many frames", label,
                       meta.end - meta.begin, meta.fps);
  }
  return {};
}

Status parse_sogst_motion(const json& root, const std::string& label, SogstMeta& meta) {
  const json &motion = member(root, "motion"), &lifespans = member(root, "trbf");
  STGS_ASSIGN(const std::uint64_t degree,
              sog_integer(member(motion, "degree"), 1, 2, label + ": motion.degree"));
  STGS_ASSIGN(meta.motion, sog_range(motion, 2, label + ": motion"));
  const json& acceleration = member(root, "accel");
  if (acceleration.is_null() == (degree == 2)) {
    return invalid_file("{}: motion.degree is {}, but accel is {}", label, degree,
                        acceleration.is_null() ? "missing" : "present");
  }
  if (degree == 2) {
    STGS_ASSIGN(meta.acceleration, sog_range(acceleration, 2, label + ": accel"));
  }
  STGS_ASSIGN(meta.centres, sog_codebook(member(lifespans, "center"), CodebookRule::kComplete,
                                         label + ": trbf.center"));
  STGS_ASSIGN(meta.deviations, sog_codebook(member(lifespans, "sigma"), CodebookRule::kComplete,
                                            label + ": trbf.sigma"));
  STGS_ASSIGN(const auto names, sog_files(lifespans, 1, label + ": trbf"));
  meta.lifespans_file = names[0];
  return {};
}

// Appends the group of splats [first, last), which must follow the groups before. `folder` is its
// entry of "streams": null if it has no splats.
Status add_group(const json& range, const json& folder, const std::string& label, SogstMeta& meta) {
  const std::uint64_t at = meta.in_groups;
  if (!range.is_array() || range.size() != 2 || !range[0].is_number_unsigned() ||
      !range[1].is_number_unsigned() || range[0].get<std::uint64_t>() != at ||
      range[1].get<std::uint64_t>() < at || range[1].get<std::uint64_t>() > meta.layout.count) {
    return invalid_file("{}: expected a range of splats that begins at {}", label, at);
  }
  const std::uint64_t count = range[1].get<std::uint64_t>() - at;
  if (count == 0) return {};
  if (!folder.is_string()) return invalid_file("{}: the group has no images in streams", label);
  if (folder.get_ref<const std::string&>().size() > kMaxSogNameBytes) {
    return invalid_file("{}: the folder in streams has a name of more than {} bytes", label,
                        kMaxSogNameBytes);
  }
  meta.in_groups += count;
  meta.groups.push_back({folder.get<std::string>() + "/", static_cast<std::size_t>(count)});
  return {};
}

// Rejects two groups with the same images.
Status check_folders(const SogstMeta& meta, const std::string& label) {
  std::vector<std::string_view> folders;
  for (const Group& group : meta.groups) folders.push_back(group.folder);
  std::sort(folders.begin(), folders.end());
  const auto twice = std::adjacent_find(folders.begin(), folders.end());
  if (twice == folders.end()) return {};
  return invalid_file("{}: streams: two groups of splats have the images in {}", label,
                      short_json(json(std::string(*twice))));
}

// `text_bytes`: of the description, which contains the names of the folders.
Status parse_groups(const json& root, const std::string& label, std::uint64_t text_bytes,
                    ImportMemory& memory, SogstMeta& meta) {
  const json &segments = member(root, "segments"), &streams = member(root, "streams");
  if (streams.is_null()) {
    meta.groups = {{"", meta.layout.count}};
    return {};
  }
  const json &list = member(segments, "list"), &folders = member(streams, "segments");
  if (!list.is_array() || !folders.is_array() || list.size() != folders.size() ||
      list.size() > kMaxSegments) {
    return invalid_file(
        "{}: segments.list and streams.segments: expected lists of one length, at "
        "most {}",
        label, kMaxSegments);
  }
  STGS_ASSIGN(meta.lease, memory.take((list.size() + 1) * kGroupMemory + 2 * text_bytes,
                                      "the groups of splats"));
  meta.groups.reserve(list.size() + 1);
  STGS_TRY(add_group(member(segments, "persistent"), member(streams, "persistent"),
                     label + ": segments.persistent", meta));
  for (std::size_t i = 0; i < list.size(); ++i) {
    STGS_TRY(add_group(member(list[i], "range"), folders[i],
                       fmt::format("{}: segments.list[{}].range", label, i), meta));
  }
  if (meta.in_groups != meta.layout.count) {
    return invalid_file("{}: the segments have {} of {} splats", label, meta.in_groups,
                        meta.layout.count);
  }
  return check_folders(meta, label);
}

Result<SogstMeta> parse_sogst_meta(std::span<const std::uint8_t> text, const std::string& label,
                                   ImportMemory& memory) {
  STGS_ASSIGN(const Charged<json> parsed, parse_json(text, label, memory));
  const json& root = parsed.value;
  const json &version = member(root, "version"), &format = member(root, "format");
  if (format != "sogst") {
    return invalid_file("{}: not the description of a .sogst (format is {}, expected \"sogst\")",
                        label, short_json(format));
  }
  if (version != 1) {
    return unsupported("{}: unsupported .sogst version (expected 1, got {})", label,
                       short_json(version));
  }
  SogstMeta meta;
  STGS_ASSIGN(meta.layout, sog_layout(root, CodebookRule::kComplete, label, memory.limits()));
  STGS_TRY(parse_sogst_time(member(root, "time"), label, meta));
  STGS_TRY(parse_sogst_motion(root, label, meta));
  if (const json& scale = member(root, "cov2d_scale"); !scale.is_null()) {
    STGS_ASSIGN(const auto factors, number_list(scale, 2, label + ": cov2d_scale"));
    std::copy_n(factors.begin(), 2, meta.footprint.begin());
  }
  STGS_TRY(parse_groups(root, label, text.size(), memory, meta));
  return meta;
}

// Reads the splats of a group: velocities and accelerations per second, lifespans in seconds.
Status read_group(SogDecoder& decoder, NamedFiles& files, const SogstMeta& meta, const Group& group,
                  std::size_t first, Gaussians4D& set, std::vector<float>& acceleration) {
  STGS_TRY(decoder.read_into(set, first));
  STGS_TRY(decoder.read_logarithms(meta.motion, "motion", set.velocity.data() + 3 * first));
  if (meta.acceleration) {
    STGS_TRY(decoder.read_logarithms(*meta.acceleration, "accel", acceleration.data() + 3 * first));
  }
  STGS_ASSIGN(const ImageRgba lifespans, decoder.splat_image(meta.lifespans_file));
  for (std::size_t i = 0; i < group.count; ++i) {
    const std::uint8_t* pixel = lifespans.pixel(i);
    set.time[first + i] = meta.centres[pixel[0]];
    set.sigma[first + i] = meta.deviations[pixel[1]];
    if (!(set.sigma[first + i] > 0)) {
      return invalid_file("{}: trbf.sigma.codebook[{}]: expected a number > 0, got {}",
                          files.label("meta.json"), pixel[1], set.sigma[first + i]);
    }
  }
  return {};
}

// Converts seconds to ticks of the scene.
void convert_times(const SogstMeta& meta, const Scene& scene, Gaussians4D& set,
                   std::vector<float>& acceleration) {
  const TimeBase& base = scene.metadata.time_base;
  const double tick = base.seconds(1), limit = kMaxClipSigma * scene.metadata.frames;
  for (float& t : set.time) t = static_cast<float>((t - meta.begin) / tick);
  for (float& v : set.velocity) v = static_cast<float>(v * tick);
  for (float& a : acceleration) a = static_cast<float>(a * tick * tick);
  for (float& s : set.sigma) {
    s = static_cast<float>(std::clamp(s * std::numbers::sqrt2 / tick, double{FLT_MIN}, limit));
  }
}

}  // namespace

Result<Scene> read_sogst(const std::string& path, const CurveSettings& settings,
                         const ReadLimits& limits, CurveReport* report, ConversionNotes* notes) {
  ImportMemory memory(limits, path);
  STGS_ASSIGN(const std::unique_ptr<NamedFiles> files, zip_files(path, memory));
  STGS_ASSIGN(ChargedBytes text, files->read("meta.json", memory, kMaxSogMetaBytes));
  STGS_ASSIGN(const SogstMeta meta,
              parse_sogst_meta(text.value, files->label("meta.json"), memory));
  text = {};
  const std::size_t count = meta.layout.count;
  for (const Group& group : meta.groups) {
    STGS_TRY(check_sog_count(*files, meta.layout, group.count, group.folder, memory));
  }
  Gaussians4D set;
  set.sh_degree = meta.layout.sh_degree();
  STGS_ASSIGN(Lease lease, memory.take_set(count, set.sh_degree));
  set.resize(count);
  Charged<std::vector<float>> acceleration;
  if (meta.acceleration) {
    STGS_ASSIGN(acceleration.lease,
                memory.take(3 * sizeof(float) * std::uint64_t{count}, "the accelerations"));
    acceleration.value.resize(3 * count);
  }
  ImageRgba centroids;
  if (meta.layout.palette) {
    STGS_ASSIGN(centroids, sog_centroids(*files, *meta.layout.palette, memory));
  }
  std::size_t first = 0;
  for (const Group& group : meta.groups) {
    SogDecoder decoder(*files, meta.layout, &centroids, memory, group.count, group.folder);
    STGS_TRY(read_group(decoder, *files, meta, group, first, set, acceleration.value));
    first += group.count;
  }
  Scene scene;
  scene.metadata.time_base = frame_time_of(meta.fps);
  const double ticks = std::ceil(scene.metadata.time_base.ticks(meta.end - meta.begin));
  if (ticks > 0xFFFFFFFF) return unsupported("{}: the clip has too many frames ({})", path, ticks);
  scene.metadata.frames = static_cast<std::uint32_t>(std::max(1.0, ticks));
  centroids = {};
  convert_times(meta, scene, set, acceleration.value);
  CurveReport done;
  done.primitives = set.size();
  if (meta.acceleration) {
    done.primitives = 0;
    STGS_ASSIGN(
        Charged<Gaussians4D> divided,
        divide_curves(set, acceleration.value, scene.metadata.frames, settings, memory, done));
    set = std::move(divided.value);
    lease = std::move(divided.lease);
  }
  drop_invalid(set, notes);
  note_curves(done, settings, notes);
  if (meta.footprint != std::array<double, 2>{1, 1}) {
    note(notes,
         fmt::format("splats are rendered at their true size, not with a footprint of {:.4g} "
                     "x {:.4g} times their covariance",
                     meta.footprint[0], meta.footprint[1]));
  }
  if (report != nullptr) *report = done;
  scene.gaussians = std::move(set);
  return scene;
}

}  // namespace stgs
