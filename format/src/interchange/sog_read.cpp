// SPDX-License-Identifier: Apache-2.0
#include "interchange/sog_read.h"

#include <algorithm>

#include "interchange/import.h"
#include "interchange/json_fields.h"
#include "interchange/sog_decoder.h"

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

Status read_sog_model(const SogModel& model, ImportMemory& memory, Gaussians4D& set,
                      std::size_t first) {
  ImageRgba centroids;
  if (model.layout.palette) {
    STGS_ASSIGN(centroids, sog_centroids(*model.files, *model.layout.palette, memory));
  }
  SogDecoder decoder(*model.files, model.layout, &centroids, memory, model.layout.count);
  return decoder.read_into(set, first);
}

}  // namespace

Result<SogModel> open_sog(std::unique_ptr<NamedFiles> files, const std::string& meta_name,
                          ImportMemory& memory) {
  SogModel model;
  model.files = std::move(files);
  STGS_ASSIGN(const ChargedBytes text, model.files->read(meta_name, memory, kMaxSogMetaBytes));
  STGS_ASSIGN(model.layout, parse_sog_meta(text.value, model.files->label(meta_name), memory));
  STGS_TRY(check_sog_count(*model.files, model.layout, model.layout.count, "", memory));
  return model;
}

void SogSet::count(const SogModel& model) {
  counted_ += model.layout.count;
  sh_degree_ = std::max(sh_degree_, model.layout.sh_degree());
}

Status SogSet::read(const SogModel& model) {
  if (set_.size() == 0) {
    STGS_ASSIGN(lease_, memory_.take_set(counted_, sh_degree_));
    set_.sh_degree = sh_degree_;
    set_.resize(static_cast<std::size_t>(counted_));
  }
  if (model.layout.count > set_.size() - done_ || model.layout.sh_degree() > sh_degree_) {
    return io_error("{}: a model changed while it was read", memory_.name());
  }
  STGS_TRY(read_sog_model(model, memory_, set_, done_));
  done_ += model.layout.count;
  return {};
}

Result<Scene> SogSet::finish(ConversionNotes* notes) {
  if (done_ < set_.size()) {
    return io_error("{}: a model changed while it was read", memory_.name());
  }
  return finish_import(std::move(set_), notes);
}

}  // namespace stgs
