// SPDX-License-Identifier: Apache-2.0
// Reading SOG version 2, as specified by PlayCanvas ("The SOG Format", developer.playcanvas.com): a
// meta.json, and images whose pixel i belongs to splat i. Axes: as 3DGS PLY.
#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>

#include "interchange/import.h"
#include "interchange/json_fields.h"
#include "interchange/sog_decoder.h"
#include "interchange/sog_models.h"
#include "stgs/format/interchange_formats.h"

namespace stgs {
namespace {

using nlohmann::json;

Result<SogLayout> parse_sog_meta(std::span<const std::uint8_t> text, const std::string& label,
                                 ImportMemory& memory) {
  STGS_ASSIGN(const Charged<json> parsed, parse_json(text, label, memory));
  const json& root = parsed.value;
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
  return sog_layout(root, CodebookRule::kMissingFirst, label, memory.limits());
}

struct SogModel {
  std::unique_ptr<NamedFiles> files;
  SogLayout layout;
};

// Reads the description. Allocates no memory for splats yet.
Result<SogModel> open_model(const std::string& path, ImportMemory& memory) {
  SogModel model;
  const std::filesystem::path model_path(path);
  std::string meta_name = "meta.json";
  if (file_extension(path) != ".json") {
    STGS_ASSIGN(model.files, zip_files(path, memory));
  } else {
    meta_name = model_path.filename().string();
    model.files = folder_files(model_path.parent_path().string());
  }
  STGS_ASSIGN(const ChargedBytes text, model.files->read(meta_name, memory, kMaxSogMetaBytes));
  STGS_ASSIGN(model.layout, parse_sog_meta(text.value, model.files->label(meta_name), memory));
  return model;
}

Status read_model(const SogModel& model, ImportMemory& memory, Gaussians4D& set,
                  std::size_t first) {
  ImageRgba centroids;
  if (model.layout.palette) {
    STGS_ASSIGN(centroids, sog_centroids(*model.files, *model.layout.palette, memory));
  }
  SogDecoder decoder(*model.files, model.layout, &centroids, memory, model.layout.count);
  return decoder.read_into(set, first);
}

// Finds the kind of a description. Keeps no values: files of any kind come here.
class KindFinder final : public nlohmann::json_sax<json> {
 public:
  // Returns nothing for a description that states no kind.
  std::optional<SogKind> kind() const {
    if (has_format_) return SogKind::kSogst;
    if (version_ == 4 || has_timeline_) return SogKind::kTsog;
    return has_version_ ? std::optional(SogKind::kSog) : std::nullopt;
  }

  bool null() override { return true; }
  bool boolean(bool) override { return take(0); }
  bool number_integer(number_integer_t) override { return take(0); }
  bool number_unsigned(number_unsigned_t value) override { return take(value); }
  bool number_float(number_float_t value, const string_t&) override {
    return take(value == 4 ? 4 : 0);
  }
  bool string(string_t&) override { return take(0); }
  bool binary(binary_t&) override { return take(0); }
  bool start_object(std::size_t) override {
    take(0);
    return ++depth_ <= kMaxJsonNesting;
  }
  bool end_object() override { return --depth_ >= 0; }
  bool start_array(std::size_t) override {
    take(0);
    return ++depth_ <= kMaxJsonNesting;
  }
  bool end_array() override { return --depth_ >= 0; }
  bool key(string_t& name) override {
    if (depth_ == 1) key_ = short_text(name, kMaxKey);
    return true;
  }
  bool parse_error(std::size_t, const std::string&, const nlohmann::detail::exception&) override {
    return false;
  }

 private:
  static constexpr std::size_t kMaxKey = 16;

  // Takes a value, which is not null, of the key.
  bool take(std::uint64_t value) {
    if (depth_ != 1) return true;
    has_format_ = has_format_ || key_ == "format";
    has_timeline_ = has_timeline_ || key_ == "timeline";
    if (key_ == "version") {
      has_version_ = true;
      version_ = value;
    }
    return true;
  }

  int depth_ = 0;
  std::string key_;
  bool has_format_ = false, has_timeline_ = false, has_version_ = false;
  std::uint64_t version_ = 0;
};

}  // namespace

SogKind sog_kind(const std::string& path) {
  ImportMemory memory({}, path);
  const auto archive = zip_files(path, memory);
  if (!archive.ok()) return sog_kind_of_extension(path);
  const auto text = archive.value()->read("meta.json", memory, kMaxSogMetaBytes);
  if (!text.ok()) return sog_kind_of_extension(path);
  KindFinder finder;
  const std::vector<std::uint8_t>& json_text = text->value;
  if (!json::sax_parse(json_text.begin(), json_text.end(), &finder)) {
    return sog_kind_of_extension(path);
  }
  return finder.kind().value_or(sog_kind_of_extension(path));
}

Result<Scene> read_sog(const std::string& path, const ReadLimits& limits, ConversionNotes* notes) {
  STGS_ASSIGN(const std::vector<std::string> paths, sog_models(path));
  ImportMemory memory(limits, path);
  std::vector<SogModel> models;
  std::uint64_t total = 0;
  int degree = 0;
  for (const std::string& model_path : paths) {
    STGS_ASSIGN(SogModel model, open_model(model_path, memory));
    total += model.layout.count;
    STGS_TRY(check_sog_count(*model.files, model.layout, model.layout.count, "", memory));
    degree = std::max(degree, model.layout.sh_degree());
    models.push_back(std::move(model));
  }
  Gaussians4D set;
  set.sh_degree = degree;
  STGS_ASSIGN(const Lease lease, memory.take_set(total, degree));
  set.resize(static_cast<std::size_t>(total));
  std::size_t first = 0;
  for (const SogModel& model : models) {
    STGS_TRY(read_model(model, memory, set, first));
    first += model.layout.count;
  }
  return finish_import(std::move(set), notes);
}

}  // namespace stgs
