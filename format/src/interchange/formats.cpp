// SPDX-License-Identifier: Apache-2.0
// The table of formats. To add a format, add a line to kFormats.
#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>

#include "interchange/sog_models.h"
#include "interchange/stgs1/stgs1.h"
#include "stgs/format/interchange_formats.h"

namespace stgs {
namespace {

using Head = std::span<const std::uint8_t>;

constexpr std::size_t kHeadBytes = 4096;

bool starts_with(Head head, std::string_view magic) {
  return head.size() >= magic.size() &&
         std::equal(magic.begin(), magic.end(), head.begin(),
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
}

bool is_ply(const std::string&, Head head, const ReadLimits&) {
  return starts_with(head, "ply\n") || starts_with(head, "ply\r");
}
bool is_stgs1_file(const std::string&, Head head, const ReadLimits&) {
  return is_stgs1(head);
}
bool is_spz(const std::string&, Head head, const ReadLimits&) {
  return starts_with(head, "NGSP") || starts_with(head, "\x1F\x8B");
}
bool is_sog(const std::string& path, Head head, const ReadLimits&) {
  return starts_with(head, "PK\x03\x04") || is_sog_folder(path) ||
         (starts_with(head, "{") && file_extension(path) == ".json");
}
bool is_sogst(const std::string& path, Head head, const ReadLimits& limits) {
  return starts_with(head, "PK\x03\x04") && sog_kind(path, limits) == SogKind::kSogst;
}
bool is_tsog(const std::string& path, Head head, const ReadLimits& limits) {
  return starts_with(head, "PK\x03\x04") && sog_kind(path, limits) == SogKind::kTsog;
}
bool is_ftgs_file(const std::string&, Head head, const ReadLimits&) {
  return is_ftgs_ply(head);
}
bool is_usda(const std::string&, Head head, const ReadLimits&) {
  return starts_with(head, "#usda");
}
bool is_splatv_file(const std::string&, Head head, const ReadLimits&) {
  return is_splatv(head);
}
bool is_4dgs_file(const std::string&, Head head, const ReadLimits&) {
  return is_4dgs(head);
}
bool is_frame_folder(const std::string& path, Head head, const ReadLimits&) {
  return head.empty() && is_ply_sequence(path);
}
bool is_gltf(const std::string&, Head head, const ReadLimits&) {
  return starts_with(head, "glTF");
}

Result<std::vector<std::uint8_t>> write_ply_set(const Gaussians4D& set, int kernel,
                                                ConversionNotes* notes) {
  note_kernel(kernel, "PLY", notes);
  return write_ply(set);
}

Result<std::vector<std::uint8_t>> write_spz_set(const Gaussians4D& set, int kernel,
                                                ConversionNotes* notes) {
  return write_spz(set, notes, kernel);
}

Result<std::vector<std::uint8_t>> write_glb_set(const Gaussians4D& set, int kernel,
                                                ConversionNotes* notes) {
  note_kernel(kernel, "glTF", notes);
  return write_glb(set);
}

Result<Scene> read_sog_models(const std::string& path, const ImportSettings&,
                              const ReadLimits& limits, ImportReport& report) {
  return read_sog(path, limits, &report.notes);
}
Result<Scene> read_sogst_clip(const std::string& path, const ImportSettings& settings,
                              const ReadLimits& limits, ImportReport& report) {
  return read_sogst(path, settings.curves, limits, &report.curves.emplace(), &report.notes);
}
Result<Scene> read_tsog_clip(const std::string& path, const ImportSettings& settings,
                             const ReadLimits& limits, ImportReport& report) {
  return read_tsog(path, settings.clip, limits, &report.notes);
}
Result<Scene> read_ftgs_clip(const std::string& path, const ImportSettings& settings,
                             const ReadLimits& limits, ImportReport& report) {
  STGS_ASSIGN(const auto source, open_file(path));
  return read_ftgs_ply(*source, settings.clip, limits, &report.notes);
}
Result<Scene> read_splatv_clip(const std::string& path, const ImportSettings& settings,
                               const ReadLimits& limits, ImportReport& report) {
  STGS_ASSIGN(const auto source, open_file(path));
  return read_splatv(*source, settings.splatv, limits, &report.splatv.emplace(), &report.notes);
}
Result<Scene> read_4dgs_clip(const std::string& path, const ImportSettings& settings,
                             const ReadLimits& limits, ImportReport& report) {
  STGS_ASSIGN(const auto source, open_file(path));
  FourdgsReport of_file;
  Result<Scene> scene = read_4dgs(*source, settings.fourdgs, limits, &of_file, &report.notes);
  report.sequence = of_file.sequence;
  return scene;
}
Result<Scene> read_frames(const std::string& path, const ImportSettings& settings,
                          const ReadLimits& limits, ImportReport& report) {
  return read_ply_sequence(path, settings.sequence, limits, &report.sequence.emplace(),
                           &report.notes);
}

Result<std::vector<std::uint8_t>> write_4dgs_scene(const Scene& scene, const ReadLimits&,
                                                   ConversionNotes* notes,
                                                   std::vector<std::uint32_t>* order) {
  return write_4dgs(scene, notes, order);
}
Result<std::vector<std::uint8_t>> write_usda_scene(const Scene& scene, const ReadLimits& limits,
                                                   ConversionNotes* notes,
                                                   std::vector<std::uint32_t>*) {
  return write_usda(scene, notes, limits.max_memory);
}

using Format = InterchangeFormat;
constexpr std::array kFormats = {
    Format{"STGS 1", "", is_stgs1_file, read_stgs1, nullptr, nullptr},
    Format{"FTGS PLY", ".ftgs.ply", is_ftgs_file, nullptr, read_ftgs_clip, nullptr, Format::kClip},
    Format{"PLY", ".ply", is_ply, read_ply, nullptr, write_ply_set},
    Format{"SPZ", ".spz", is_spz, read_spz, nullptr, write_spz_set},
    Format{"sogst", ".sogst", is_sogst, nullptr, read_sogst_clip, nullptr, Format::kCurves},
    Format{"tsog", ".tsog", is_tsog, nullptr, read_tsog_clip, nullptr, Format::kClip},
    Format{"SOG", ".sog", is_sog, nullptr, read_sog_models, nullptr},
    Format{"splatv", ".splatv", is_splatv_file, nullptr, read_splatv_clip, nullptr,
           Format::kSplatv},
    Format{"PLY frames", "", is_frame_folder, nullptr, read_frames, nullptr, Format::kSequence},
    Format{"glTF", ".glb", is_gltf, nullptr, nullptr, write_glb_set},
    Format{"4dgs", ".4dgs", is_4dgs_file, nullptr, read_4dgs_clip, nullptr, Format::kFourdgs,
           write_4dgs_scene, read_back_4dgs},
    Format{"USD", ".usda", is_usda, nullptr, nullptr, nullptr, Format::kNone, write_usda_scene},
};

}  // namespace

std::span<const InterchangeFormat> interchange_formats() {
  return kFormats;
}

std::string file_extension(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

Result<const InterchangeFormat*> detect_format(const std::string& path, const ReadLimits& limits) {
  std::vector<std::uint8_t> head;
  std::error_code error;
  if (!std::filesystem::is_directory(path, error)) {
    STGS_ASSIGN(const auto source, open_file(path));
    head.resize(static_cast<std::size_t>(std::min<std::uint64_t>(source->size(), kHeadBytes)));
    STGS_TRY(source->read(0, head));
  }
  for (const InterchangeFormat& format : kFormats) {
    if (format.matches(path, head, limits)) return &format;
  }
  return nullptr;
}

Result<Scene> read_interchange(const InterchangeFormat& format, const std::string& path,
                               const ImportSettings& settings, const ReadLimits& limits,
                               ImportReport& report) {
  if (format.read_path != nullptr) return format.read_path(path, settings, limits, report);
  if (format.read == nullptr)
    return unsupported("{}: cannot read {}, only write it", path, format.name);
  STGS_ASSIGN(const auto source, open_file(path));
  return format.read(*source, limits, &report.notes);
}

const InterchangeFormat* format_for_output(const std::string& path) {
  const std::string extension = file_extension(path);
  const auto found = std::find_if(kFormats.begin(), kFormats.end(), [&](const auto& format) {
    return format.is_writable() && extension == format.extension;
  });
  return found == kFormats.end() ? nullptr : &*found;
}

}  // namespace stgs
