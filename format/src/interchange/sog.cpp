// SPDX-License-Identifier: Apache-2.0
// Reading SOG version 2, as specified by PlayCanvas ("The SOG Format", developer.playcanvas.com): a
// meta.json, and images whose pixel i belongs to splat i. Axes: as 3DGS PLY.
#include <algorithm>
#include <filesystem>
#include <memory>

#include "interchange/import.h"
#include "interchange/json_fields.h"
#include "interchange/sog_decoder.h"
#include "interchange/sog_models.h"
#include "stgs/format/interchange_formats.h"

namespace stgs {
namespace {

using nlohmann::json;

Result<SogLayout> parse_sog_meta(std::span<const std::uint8_t> text, const std::string& label,
                                 const ReadLimits& limits) {
  STGS_ASSIGN(const json root, parse_json(text, label));
  const json& version = member(root, "version");
  if (version.is_null() && root.is_object() && root.contains("means")) {
    return unsupported("{}: unsupported SOG version (expected 2, got 1)", label);
  }
  if (!version.is_number_unsigned()) {
    return invalid_file("{}: not the description of a SOG model (no version)", label);
  }
  if (version != 2) {
    return unsupported("{}: unsupported SOG version (expected 2, got {})", label,
                       short_json(version));
  }
  return sog_layout(root, CodebookRule::kMissingFirst, label, limits);
}

struct SogModel {
  std::unique_ptr<NamedFiles> files;
  SogLayout layout;
};

// Reads the description. Allocates no memory for splats yet.
Result<SogModel> open_model(const std::string& path, const ReadLimits& limits) {
  SogModel model;
  const std::filesystem::path model_path(path);
  std::string meta_name = "meta.json";
  if (file_extension(path) != ".json") {
    STGS_ASSIGN(model.files, zip_files(path));
  } else {
    meta_name = model_path.filename().string();
    model.files = folder_files(model_path.parent_path().string());
  }
  STGS_ASSIGN(const std::vector<std::uint8_t> text,
              model.files->read(meta_name, max_sog_meta_bytes(limits)));
  STGS_ASSIGN(model.layout, parse_sog_meta(text, model.files->label(meta_name), limits));
  return model;
}

Status read_model(const SogModel& model, const ReadLimits& limits, Gaussians4D& set,
                  std::size_t first) {
  ImageRgba centroids;
  if (model.layout.palette) {
    STGS_ASSIGN(centroids, sog_centroids(*model.files, *model.layout.palette, limits));
  }
  SogDecoder decoder(*model.files, model.layout, &centroids, limits, model.layout.count);
  return decoder.read_into(set, first);
}

}  // namespace

SogKind sog_kind(const std::string& path) {
  const auto archive = zip_files(path);
  if (!archive.ok()) return sog_kind_of_extension(path);
  const auto text = archive.value()->read("meta.json", kMaxSogMetaBytes);
  if (!text.ok()) return sog_kind_of_extension(path);
  const auto root = parse_json(*text, path);
  if (!root.ok()) return sog_kind_of_extension(path);
  if (!member(*root, "format").is_null()) return SogKind::kSogst;
  const json& version = member(*root, "version");
  if (version == 4 || !member(*root, "timeline").is_null()) return SogKind::kTsog;
  return version.is_null() ? sog_kind_of_extension(path) : SogKind::kSog;
}

Result<Scene> read_sog(const std::string& path, const ReadLimits& limits, ConversionNotes* notes) {
  STGS_ASSIGN(const std::vector<std::string> paths, sog_models(path));
  std::vector<SogModel> models;
  std::uint64_t total = 0, image_bytes = 0;
  int degree = 0;
  for (const std::string& model_path : paths) {
    STGS_ASSIGN(SogModel model, open_model(model_path, limits));
    total += model.layout.count;
    STGS_ASSIGN(const std::uint64_t bytes,
                check_sog_count(*model.files, model.layout, model.layout.count, "", limits));
    image_bytes = std::max(image_bytes, bytes);
    degree = std::max(degree, model.layout.sh_degree());
    models.push_back(std::move(model));
  }
  STGS_TRY(check_import_size(path, total, degree, limits, image_bytes));
  Gaussians4D set;
  set.sh_degree = degree;
  set.resize(static_cast<std::size_t>(total));
  const ReadLimits rest = limits_beside(limits, total, degree);
  std::size_t first = 0;
  for (const SogModel& model : models) {
    STGS_TRY(read_model(model, rest, set, first));
    first += model.layout.count;
  }
  return finish_import(std::move(set), notes);
}

}  // namespace stgs
