// SPDX-License-Identifier: Apache-2.0
// `stgs convert`: files and folders of any name and content, whose format is detected. Covers the
// readers that need several files, PLY frames and SOG folders. The scene is then written in
// each format.
//
// Input: the files, one after another: u8 number of a name, u32 size, content. A first file with
// a name of kSingleNames is read alone; otherwise a folder with all of them.
#include <array>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>

#include "../fixtures/fourdgs_fixture.h"
#include "../fixtures/ftgs_fixture.h"
#include "../fixtures/splatv_fixture.h"
#include "../fixtures/temporary_folder.h"
#include "imported.h"
#include "stgs/format/interchange_formats.h"

#ifdef STGS_FUZZ_SOG
#include "../fixtures/sogst_fixture.h"
#endif

using namespace stgs;
using namespace stgs::fuzz;

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxFiles = 24, kFileHead = 5;
constexpr std::size_t kMaxWritten = 300;  // primitives of scenes that are written
constexpr std::array kSingleNames = {"input", "input.json", "input.sogst", "input.tsog",
                                     "input.SOG"};
// Of files in a folder. The images are those of the fixtures.
constexpr std::array kNames = {
    "frame_1.ply", "frame_2.ply",   "frame_3.ply",  "2.ply",          "frame_9.ply",   "frame.ply",
    "meta.json",   "a/meta.json",   "b.sog",        "lod-meta.json",  "l.webp",        "u.webp",
    "scales.webp", "quats.webp",    "sh0.webp",     "centroids.webp", "labels.webp",   "a/l.webp",
    "a/u.webp",    "a/scales.webp", "a/quats.webp", "a/sh0.webp",     "a/labels.webp", "notes.txt"};

// A file of the input. A size beyond the end is clipped.
struct InputFile {
  std::size_t name = 0;  // of kSingleNames, or, beyond them, of kNames
  View content;
  std::size_t begin = 0, end = 0;  // of the input
};

std::vector<InputFile> files_of(View input) {
  std::vector<InputFile> out;
  for (std::size_t at = 0; at + kFileHead <= input.size() && out.size() < kMaxFiles;) {
    std::uint32_t size = 0;
    std::memcpy(&size, &input[at + 1], sizeof size);
    const std::size_t clipped = std::min<std::size_t>(size, input.size() - at - kFileHead);
    const std::size_t end = at + kFileHead + clipped;
    out.push_back({input[at] % (kSingleNames.size() + kNames.size()),
                   input.subspan(at + kFileHead, clipped), at, end});
    at = end;
  }
  return out;
}

void write(const std::string& path, View content) {
  fs::create_directories(fs::path(path).parent_path());
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(content.data()),
             static_cast<std::streamsize>(content.size()));
}

// Writes the files and returns the path to read.
std::string write_input(const std::vector<InputFile>& files, const std::string& folder) {
  if (!files.empty() && files[0].name < kSingleNames.size()) {
    const std::string path = folder + "/" + kSingleNames[files[0].name];
    write(path, files[0].content);
    return path;
  }
  for (const InputFile& file : files) {
    if (file.name >= kSingleNames.size())
      write(folder + "/" + kNames[file.name - kSingleNames.size()], file.content);
  }
  return folder;
}

template <typename Content>
void add_file(Bytes& input, const std::string& name, const Content& content) {
  std::size_t number = 0;
  while (number < kSingleNames.size() && kSingleNames[number] != name) ++number;
  for (std::size_t i = 0; number >= kSingleNames.size() && i < kNames.size(); ++i) {
    if (kNames[i] == name) number = kSingleNames.size() + i;
  }
  const auto size = static_cast<std::uint32_t>(std::size(content));
  input.push_back(static_cast<std::uint8_t>(number));
  for (int shift = 0; shift < 32; shift += 8)
    input.push_back(static_cast<std::uint8_t>(size >> shift));
  input.insert(input.end(), std::begin(content), std::end(content));
}

template <typename Content>
Bytes single(const std::string& name, const Content& content) {
  Bytes input;
  add_file(input, name, content);
  return input;
}

Bytes ply_of(const Gaussians4D& set) {
  auto bytes = write_ply(set);
  require(bytes.ok(), "seeds can be written");
  return std::move(*bytes);
}

// Frames that are missing, or have another degree.
Bytes broken_frames(const std::string& last, int degree) {
  Bytes input;
  const Bytes frame = ply_of(testing::random_scene(2, 0, 1, 5).gaussians);
  for (const char* name : {"frame_1.ply", "frame_2.ply"}) add_file(input, name, frame);
  add_file(input, last, ply_of(testing::random_scene(2, degree, 1, 5).gaussians));
  return input;
}

// Splats that stay, move, change, appear and vanish.
Bytes ply_frames() {
  Gaussians4D set = testing::random_scene(8, 1, 1, 5).gaussians;
  Bytes input;
  for (const char* name : {"frame_1.ply", "frame_2.ply", "frame_3.ply"}) {
    add_file(input, name, ply_of(set));
    for (std::size_t i = 0; i < 3; ++i) set.position[3 * i] += 0.01f;
    set.opacity_logit[4] += 1;
    set.position[15] += 10;
    set = set.gather({1, 0, 2, 3, 4, 5, 6});
  }
  return input;
}

#ifdef STGS_FUZZ_SOG
void add_sog_seeds(std::vector<Bytes>& out) {
  const testing::SogModel model = testing::random_sog(3, 1, 6);
  Bytes folder, nested;
  for (const auto& [name, content] : model.all_files()) {
    add_file(folder, name, content);
    if (name != "centroids.webp") add_file(nested, "a/" + name, content);
  }
  out.push_back(folder);
  out.push_back(nested);
  static const testing::TemporaryFolder bundles;
  for (const testing::SogModel& clip :
       {testing::random_sogst(3, 0, 2, 3, 1, 2), testing::continuous_tsog(3, 0, 2, 5)}) {
    clip.write_bundle(bundles / "clip");
    std::ifstream file(bundles / "clip", std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), {}};
    for (const char* name : {"input", "input.sogst", "input.tsog"})
      out.push_back(single(name, bytes));
  }
}
#endif

std::vector<Bytes> seeds() {
  const Gaussians4D set = testing::random_scene(3, 0, 1, 5).gaussians;
  auto spz = write_spz(set), glb = write_glb(set);
  auto fourdgs = write_4dgs(testing::random_scene(5, 0, 4, 5));
  auto usda = write_usda(static_scene(set));
  require(spz.ok() && glb.ok() && fourdgs.ok() && usda.ok(), "seeds can be written");
  std::vector<Bytes> out = {ply_frames(),
                            broken_frames("frame_9.ply", 0),
                            broken_frames("frame_3.ply", 1),
                            single("frame.ply", ply_of(set)),
                            single("input", ply_of(set)),
                            single("input", *spz),
                            single("input", *glb),
                            single("input", *fourdgs),
                            single("input", *usda),
                            single("input", testing::ftgs_file(2).bytes()),
                            single("input", testing::splatv_file({{}})),
                            single("lod-meta.json", std::string("{}")),
                            single("notes.txt", std::string("no model"))};
#ifdef STGS_FUZZ_SOG
  add_sog_seeds(out);
#endif
  return out;
}

std::vector<Unit> units(View input) {
  std::vector<Unit> out;
  for (const InputFile& file : files_of(input)) {
    out.push_back({file.begin, std::min(file.begin + kFileHead, file.end)});
    out.push_back({std::min(file.begin + kFileHead, file.end), file.end});
  }
  return out;
}

// A frame is kept besides the primitives, of SOG models the images and the JSON; and the text of a
// written scene.
std::uint64_t memory(View input) {
  return 3 * import_memory(input) + 64 * input.size() + (4 << 20);
}

void check_failure(const Status& status) {
  // kUsage: file names without frame numbers. kIo: files that a folder lacks.
  const StatusCode code = status.code();
  require(code == StatusCode::kInvalidFile || code == StatusCode::kUnsupported ||
              code == StatusCode::kUsage || code == StatusCode::kIo ||
              code == StatusCode::kNotBuilt,
          "a reader rejects files only because of their content");
  require(!status.message().empty(), "an error has a message");
}

void check_snapshots(const Scene& scene) {
  const double frames = scene.metadata.frames;
  for (const double ticks : {0.0, frames / 2, frames}) {
    const auto set = snapshot_at(scene, ticks);
    require(set.ok() && set->size() <= scene.gaussians.size(), "an imported scene has snapshots");
  }
}

// Writes a scene in a format and reads it again.
void check_writer(const InterchangeFormat& format, const Scene& scene, const Gaussians4D& set) {
  ConversionNotes notes;
  require(format_for_output(std::string("a") + format.extension) != nullptr,
          "a format that can be written has an extension");
  if (format.write != nullptr) {
    const auto bytes = format.write(set, scene.metadata.kernel, &notes);
    if (!bytes.ok()) return check_failure(bytes.status());
    if (format.read == nullptr) return;
    const auto again = format.read(*memory_source(*bytes, "output"), {}, &notes);
    require(again.ok(), "a written file can be read");
    (void)conversion_errors(set, *again);
    return;
  }
  std::vector<std::uint32_t> order;
  const auto bytes = format.write_scene(scene, kImportLimits, &notes, &order);
  if (!bytes.ok()) return check_failure(bytes.status());
  if (format.read_back == nullptr) return;
  const auto again = format.read_back(*memory_source(*bytes, "output"), {});
  require(again.ok() && again->gaussians.size() == order.size(), "a written file can be read");
  (void)conversion_errors(scene.gaussians.gather(order), *again);
}

void check_writers(const Scene& scene) {
  if (scene.gaussians.size() > kMaxWritten) return;
  (void)list_metadata(scene.metadata, "the camera", true);
  const auto set = snapshot_at(scene, scene.metadata.frames / 2.0);
  for (const InterchangeFormat& format : interchange_formats()) {
    if (format.is_writable()) check_writer(format, scene, *set);
  }
}

}  // namespace

const Target stgs::fuzz::kTarget{"import", seeds, nullptr, nullptr, units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const testing::TemporaryFolder root;
  const std::string folder = root / "input";
  fs::create_directories(folder);
  const std::string path = write_input(files_of({data, size}), folder);
  const auto format = detect_format(path);
  require(format.ok(), "the format of a readable file is known or unknown");
  if (*format != nullptr) {
    ImportReport report;
    const auto scene = read_interchange(**format, path, {}, kImportLimits, report);
    if (scene.ok()) {
      check_import(scene);
      check_snapshots(*scene);
      check_writers(*scene);
    } else {
      check_failure(scene.status());
    }
  }
  fs::remove_all(folder);
  return 0;
}
