// SPDX-License-Identifier: Apache-2.0
// Where the files of SOG models are, and the kind of an archive.
#include <filesystem>
#include <memory>
#include <optional>

#include "interchange/json_fields.h"
#include "interchange/sog_models.h"
#include "interchange/sog_read.h"
#include "stgs/format/interchange_formats.h"

namespace stgs {
namespace {

using nlohmann::json;

// Reads the description of a model at a path.
Result<SogModel> open_path(const std::string& path, ImportMemory& memory) {
  if (file_extension(path) != ".json") {
    STGS_ASSIGN(std::unique_ptr<NamedFiles> files, zip_files(path, memory));
    return open_sog(std::move(files), "meta.json", memory);
  }
  const std::filesystem::path meta(path);
  return open_sog(folder_files(meta.parent_path().string()), meta.filename().string(), memory);
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

SogKind sog_kind(const std::string& path, const ReadLimits& limits) {
  ImportMemory memory(limits, path);
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
  SogSet set(memory);
  // One model is open at a time: there may be more than the process may open files.
  for (const std::string& model_path : paths) {
    STGS_ASSIGN(const SogModel model, open_path(model_path, memory));
    set.count(model);
  }
  for (const std::string& model_path : paths) {
    STGS_ASSIGN(const SogModel model, open_path(model_path, memory));
    STGS_TRY(set.read(model));
  }
  return set.finish(notes);
}

}  // namespace stgs
